"""The clips every animal gets: ``idle``, ``walk``, ``trot`` and ``look_around``, drawn as curves over its own bones."""

import numpy as np
from jaxtyping import Float

from fauna.export.animal import Clip, RiggedAnimal
from fauna.export.gait import GRAVITY, TROT, WALK, Gait, footfalls_of, stands_still, step_length, strides
from fauna.export.motion import Motion
from fauna.export.slide import foot_slide
from fauna.export.stance import Stance, settle, stance_of

_STILL_FRAMES_PER_SECOND = 10

_LOOKS = ((0.0, 0, 0), (0.12, 0, -4), (0.25, 38, -6), (0.42, 38, 0), (0.62, -38, 0), (0.78, -38, -8), (1.0, 0, 0))
"""Share of the clip, yaw and pitch of the head in degrees; smooth between."""


def author_clips(animal: RiggedAnimal) -> tuple[tuple[Clip, ...], tuple[str, ...]]:
    """All clips of an animal, and what is doubtful about its legs."""
    stance = stance_of(animal)
    clips = idle(animal, stance), gait_clip(animal, stance, WALK), gait_clip(animal, stance, TROT)
    return (*clips, look_around(animal, stance)), stance.notes


def gait_clip(animal: RiggedAnimal, stance: Stance, gait: Gait) -> Clip:
    """A stride in place; the ground goes by at ``speed``."""
    height = stance.hip_height
    period = gait.period * float(np.sqrt(height / GRAVITY))
    step = step_length(gait, stance)
    motion = Motion(animal, np.linspace(0.0, period, gait.frames + 1))
    turn = 2.0 * np.pi * np.arange(gait.frames + 1) / gait.frames
    sway, nod = gait.sway_deg * np.sin(turn), gait.nod_deg * np.sin(2.0 * turn)
    motion.translation[:, 1] = -gait.bob * height * np.cos(2.0 * turn - 2.0 * np.pi * gait.duty)
    motion.turn("root", roll_deg=0.5 * sway)
    for joint, share in (("spine_front", 0.5), ("chest", 0.5), ("neck", -0.6), ("head", -0.4)):
        motion.turn(joint, yaw_deg=share * sway)
    for joint, share in (("spine_rear", 0.5), ("loin", 0.5)):
        motion.turn(joint, yaw_deg=share * sway)
    motion.turn("neck", pitch_deg=0.6 * nod)
    motion.turn("head", pitch_deg=0.4 * nod)
    motion.turn("tail", yaw_deg=3.0 * gait.sway_deg * np.cos(turn))
    settle(motion, strides(gait, stance, step), vault=gait.vault)
    speed = step / (gait.duty * period)
    return _finish(motion, stance, gait.name, speed=speed, duty=gait.duty, footfalls=footfalls_of(gait, stance))


def idle(animal: RiggedAnimal, stance: Stance) -> Clip:
    """Breathing, shifting weight and a slow tail, all feet on the ground."""
    motion = Motion(animal, _times(4.0))
    turn = 2.0 * np.pi * motion.times / motion.times[-1]
    motion.translation[:, 0] = 0.008 * stance.hip_height * np.sin(turn)
    motion.translation[:, 1] = 0.004 * stance.hip_height * (np.cos(2.0 * turn) - 1.0)
    motion.turn("chest", pitch_deg=0.6 * np.cos(2.0 * turn))
    motion.turn("neck", pitch_deg=1.5 * np.sin(2.0 * turn), yaw_deg=2.0 * np.sin(turn))
    motion.turn("head", pitch_deg=1.0 * np.sin(2.0 * turn - 0.6), yaw_deg=2.0 * np.sin(turn - 0.5))
    motion.turn("tail", yaw_deg=6.0 * np.sin(turn + 1.0))
    return _stand(motion, stance, "idle")


def look_around(animal: RiggedAnimal, stance: Stance) -> Clip:
    """Head to the left, to the right and back, all feet on the ground."""
    motion = Motion(animal, _times(6.0))
    shares, yaws, pitches = np.array(_LOOKS).T
    now = motion.times / motion.times[-1]
    yaw, pitch = _smooth(now, shares, yaws), _smooth(now, shares, pitches)
    for joint, share in (("chest", 0.15), ("neck", 0.40), ("head", 0.45)):
        motion.turn(joint, yaw_deg=share * yaw, pitch_deg=share * pitch)
    motion.turn("tail", yaw_deg=5.0 * np.sin(4.0 * np.pi * now))
    return _stand(motion, stance, "look_around")


def _stand(motion: Motion, stance: Stance, name: str) -> Clip:
    settle(motion, stands_still(stance, len(motion.times)), vault=0.0)
    return _finish(motion, stance, name, speed=0.0, duty=1.0, footfalls=(0.0, 0.0, 0.0, 0.0))


def _finish(
    motion: Motion, stance: Stance, name: str, *, speed: float, duty: float, footfalls: tuple[float, ...]
) -> Clip:
    falls = {
        leg.joints.name: footfall
        for leg, footfall, grounded in zip(stance.legs, footfalls, stance.grounded, strict=True)
        if grounded
    }
    extras = {"duty_factor": duty, "footfalls": falls}
    clip = motion.clip(name, loop=True, speed=speed, extras=extras)
    slide = foot_slide(motion.animal, clip)
    clip.extras["foot_slide"] = max(slide.values())
    return clip


def _times(seconds: float) -> Float[np.ndarray, " frame"]:
    return np.linspace(0.0, seconds, round(seconds * _STILL_FRAMES_PER_SECOND) + 1)


def _smooth(
    now: Float[np.ndarray, " frame"], at: Float[np.ndarray, " key"], values: Float[np.ndarray, " key"]
) -> Float[np.ndarray, " frame"]:
    """From value to value, slow at both ends (smoothstep)."""
    key = (np.searchsorted(at, now, side="right") - 1).clip(0, len(at) - 2)
    share = (now - at[key]) / (at[key + 1] - at[key])
    return values[key] + (values[key + 1] - values[key]) * share**2 * (3.0 - 2.0 * share)
