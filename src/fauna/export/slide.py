"""How far standing feet slide over the ground, measured on the finished clip as a player shows it."""

import numpy as np
from jaxtyping import Float

from fauna.export.animal import Clip, RiggedAnimal, rigid
from fauna.export.legs import Leg, legs_of

_SAMPLES = 60
"""Moments of a stance that are looked at; they do not fall on frames."""


def foot_slide(animal: RiggedAnimal, clip: Clip) -> dict[str, float]:
    """Largest distance of any vertex of each standing sole from where the ground would have taken it.

    The ground moves backwards at the clip's ``speed``; a vertex's place on it is that of the middle of its stance. Vertices
    are posed with their four weights; where a foot carries none, the end of its bone counts.

    Returns:
        Share of the leg's length, of each leg that the clip's ``footfalls`` names.
    """
    period, duty = float(clip.times[-1]), clip.extras["duty_factor"]
    slides = {}
    for leg in legs_of(animal):
        footfall = clip.extras["footfalls"].get(leg.joints.name)
        if footfall is None:
            continue
        since = duty * period * np.linspace(0.0, 1.0, _SAMPLES)
        rotations, translation = sample(clip, (footfall * period + since) % period)
        ground = _soles(animal, leg, rotations, translation) + np.outer(since, (0.0, 0.0, clip.speed))[:, None]
        apart = np.linalg.norm(ground - ground[_SAMPLES // 2], axis=-1)
        slides[leg.joints.name] = float(apart.max() / leg.length)
    return slides


def _soles(
    animal: RiggedAnimal, leg: Leg, rotations: Float[np.ndarray, "time 21 4"], translation: Float[np.ndarray, "time 3"]
) -> Float[np.ndarray, "time point 3"]:
    """The vertices of a leg's sole in poses; the sole itself, carried by the foot bone, where there are none."""
    moved = animal.joint_transforms(rotations, translation) @ np.linalg.inv(rigid(animal.frames, animal.starts))
    vertices = leg.sole_vertices
    if not len(vertices):
        foot = moved[:, None, leg.joints.joints[2]]
        return foot[..., :3, :3] @ leg.sole + foot[..., :3, 3]
    blended = np.einsum("vi,tvijk->tvjk", animal.weights[vertices], moved[:, animal.influences[vertices], :3])
    return np.einsum("tvjk,vk->tvj", blended[..., :3], animal.vertices[vertices]) + blended[..., 3]


def sample(
    clip: Clip, times: Float[np.ndarray, " time"]
) -> tuple[Float[np.ndarray, "time joint 4"], Float[np.ndarray, "time 3"]]:
    """Rotations and the root's translation at any times within a clip, mixed as players mix them."""
    after = np.searchsorted(clip.times, times, side="right").clip(1, len(clip.times) - 1)
    share = (times - clip.times[after - 1]) / (clip.times[after] - clip.times[after - 1])
    rotations = slerp(clip.rotations[after - 1], clip.rotations[after], share[:, None, None])
    moved = clip.translation[after] - clip.translation[after - 1]
    return rotations, clip.translation[after - 1] + share[:, None] * moved


def slerp(
    start: Float[np.ndarray, "*batch 4"], end: Float[np.ndarray, "*batch 4"], share: Float[np.ndarray, "*#batch 1"]
) -> Float[np.ndarray, "*batch 4"]:
    """Rotations between two at constant speed, on the shorter way (glTF 2.0, appendix C.4)."""
    cosine = (start * end).sum(axis=-1, keepdims=True)
    end, cosine = np.where(cosine < 0.0, -end, end), np.abs(cosine).clip(max=1.0)
    angle = np.arccos(cosine)
    small = angle < 1e-6
    sine = np.where(small, 1.0, np.sin(angle))
    first = np.where(small, 1.0 - share, np.sin((1.0 - share) * angle) / sine)
    second = np.where(small, share, np.sin(share * angle) / sine)
    mixed = first * start + second * end
    return mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)
