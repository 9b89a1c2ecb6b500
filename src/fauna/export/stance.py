"""How a body stands on its legs: which of them reach the ground, and how low the back has to be."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from fauna.export.animal import RiggedAnimal
from fauna.export.joints import REAR_CHAIN
from fauna.export.legs import Leg, legs_of
from fauna.export.motion import Motion, Steps

_FLOATING = 0.2
"""A foot that ends higher above the ground is no foot; share of the back's height."""

_SHORTEST = 0.35
"""A leg whose hip is lower is no leg; share of the highest hip."""

_MAX_PITCH_DEG = 12.0


@dataclass(frozen=True, eq=False)
class Stance:
    """What clips have to know about the legs.

    Attributes:
        legs: all four.
        grounded: which of them reach the ground.
        hip_height: mean over these, metres.
        notes: what is doubtful, one sentence each.
    """

    legs: tuple[Leg, ...]
    grounded: tuple[bool, ...]
    hip_height: float
    notes: tuple[str, ...]

    @property
    def standing(self) -> tuple[Leg, ...]:
        """The legs that reach the ground."""
        return tuple(leg for leg, grounded in zip(self.legs, self.grounded, strict=True) if grounded)


def stance_of(animal: RiggedAnimal) -> Stance:
    """Look at the legs of an animal at rest."""
    legs, back = legs_of(animal), float(animal.starts[0, 1])
    highest = max(leg.hip[1] for leg in legs)
    grounded = tuple(bool(leg.sole[1] < _FLOATING * back and leg.hip[1] > _SHORTEST * highest) for leg in legs)
    if not any(grounded):
        grounded = tuple(leg is max(legs, key=lambda each: each.length) for leg in legs)
    heights = [leg.hip[1] for leg, on_ground in zip(legs, grounded, strict=True) if on_ground]
    notes = [
        f"the {_words(leg)} leg does not reach the ground and is not animated"
        for leg, on_ground in zip(legs, grounded, strict=True)
        if not on_ground
    ]
    notes += [
        f"the {_words(leg)} leg hangs behind the middle of the back: its bones may lie in another leg"
        for leg in legs
        if leg.joints.front and leg.parent in REAR_CHAIN
    ]
    return Stance(legs, grounded, float(np.mean(heights)), tuple(notes))


def _words(leg: Leg) -> str:
    return leg.joints.name.replace("_", " ")


def settle(motion: Motion, steps: Sequence[Steps], *, vault: float) -> None:
    """Pitch and lower the body so that every standing foot reaches its place; then bend the legs.

    Args:
        motion: complete but for the legs; receives the pitch, the height and the legs.
        steps: of all feet.
        vault: share of the way in which the body rises over a standing leg and sinks between two of them; with 0 it stays as
            low as it has to be at its lowest.
    """
    grounded = [each for each in steps if each.grounded]
    ends = [[each for each in grounded if each.leg.joints.front == front] for front in (True, False)]
    places = [float(np.mean([each.leg.hip[2] for each in end])) if end else 0.0 for end in ends]
    apart = places[0] - places[1]
    if all(ends) and apart > 0.0:
        front, rear = (_followed(_worst(motion, end), vault) for end in ends)
        pitch = np.degrees(np.arctan((front - rear) / apart)).clip(-_MAX_PITCH_DEG, _MAX_PITCH_DEG)
        motion.turn("root", pitch_deg=pitch)
    motion.translation[:, 1] -= _followed(_worst(motion, grounded), vault)
    for each in steps:
        motion.place_foot(each)


def _worst(motion: Motion, steps: Sequence[Steps]) -> Float[np.ndarray, " frame"]:
    """How much too high the highest of these hips is in each frame."""
    return np.max([motion.excess(each) for each in steps], axis=0)


def _followed(excess: Float[np.ndarray, " frame"], vault: float) -> Float[np.ndarray, " frame"]:
    """A smooth curve that is nowhere below, as near as ``vault`` says; the last frame repeats the first."""
    round_ = excess[:-1]
    highest = round_.max()
    window = len(round_) // 16 * 2 + 1
    envelope = maximum_filter1d(np.where(np.isfinite(round_), round_, highest), window, mode="wrap")
    smooth = uniform_filter1d(envelope, window, mode="wrap")  # a mean of maxima that all reach the frame
    followed = highest + vault * (smooth - highest)
    return np.append(followed, followed[0])
