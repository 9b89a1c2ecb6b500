"""How a body stands on its legs: which of them reach the ground, and how low the back has to be."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from fauna.export.animal import RiggedAnimal
from fauna.export.joints import ROOT
from fauna.export.legs import Leg, legs_of
from fauna.export.motion import Motion, Steps

_FLOATING = 0.2
"""A foot that ends higher above the ground is no foot; share of the back's height."""

_SHORTEST = 0.35
"""A leg whose hip is lower is no leg; share of the highest hip."""

_CROWDED = 0.4
"""A front foot that stands so little before the hind foot is in the same leg; share of the back's height."""

_MAX_PITCH_DEG = 12.0


@dataclass(frozen=True, eq=False)
class Stance:
    """What clips have to know about the legs.

    Attributes:
        legs: all four.
        grounded: which of them reach the ground.
        follows: index of the leg whose footfalls each leg has: its own, or the one behind it that it lies in.
        hip_height: mean over the grounded legs, metres.
        notes: what is doubtful, one sentence each.
    """

    legs: tuple[Leg, ...]
    grounded: tuple[bool, ...]
    follows: tuple[int, ...]
    hip_height: float
    notes: tuple[str, ...]

    @property
    def standing(self) -> tuple[Leg, ...]:
        """The legs that reach the ground."""
        return tuple(leg for leg, grounded in zip(self.legs, self.grounded, strict=True) if grounded)


def stance_of(animal: RiggedAnimal) -> Stance:
    """Look at the legs of an animal at rest."""
    legs, back = legs_of(animal), float(animal.starts[ROOT, 1])
    highest = max(leg.hip[1] for leg in legs)
    grounded = tuple(bool(leg.sole[1] < _FLOATING * back and leg.hip[1] > _SHORTEST * highest) for leg in legs)
    if not any(grounded):
        grounded = tuple(leg.hip[1] == highest for leg in legs)
    follows = [0, 1, 2, 3]
    for front, hind in ((0, 2), (1, 3)):
        gap = legs[front].sole[2] - legs[hind].sole[2]
        if grounded[front] and grounded[hind] and gap < _CROWDED * back:
            follows[front] = hind
    height = float(np.mean([leg.hip[1] for leg, on_ground in zip(legs, grounded, strict=True) if on_ground]))
    return Stance(legs, grounded, tuple(follows), height, _notes(legs, grounded, follows))


def _notes(legs: Sequence[Leg], grounded: Sequence[bool], follows: Sequence[int]) -> tuple[str, ...]:
    notes = []
    for end, pair in (("front", (0, 1)), ("hind", (2, 3))):
        if not all(grounded[leg] for leg in pair):
            notes.append(f"{end} legs: their bones do not reach the ground, clips leave them straight")
        if any(follows[leg] != leg for leg in pair):
            notes.append(f"{end} legs: their bones lie in the other legs and go with them")
        elif end == "front" and any(legs[leg].hip[2] < 0.0 for leg in pair):
            notes.append("front legs: their bones hang behind the middle of the back")
    return tuple(notes)


def settle(motion: Motion, steps: Sequence[Steps], *, vault: float) -> None:
    """Pitch and lower the body so that every standing foot reaches its place; then bend the legs.

    Args:
        motion: complete but for the legs; receives the pitch, the height and the legs.
        steps: of all feet.
        vault: share of the way in which the body rises over a standing leg and sinks between two; with 0 it stays as
            low as it has to be at its lowest.
    """
    grounded = [each for each in steps if each.grounded]
    ends = [[each for each in grounded if each.as_front == front] for front in (True, False)]
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
