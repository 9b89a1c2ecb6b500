"""Gaits: which foot is on the ground when, and where it is relative to the body, which stays in place.

Times and lengths follow the legs: animals of different size move alike when lengths are measured in hip heights h and
times in sqrt(h / g) (Alexander and Jayes, "A dynamic similarity hypothesis for the gaits of quadrupedal mammals",
1983).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fauna.export.legs import Leg
from fauna.export.motion import Steps
from fauna.export.stance import Stance

GRAVITY = 9.81
"""Metres per second squared."""

_SPREAD = 0.5
"""Largest horizontal distance of a standing foot's ankle from below its hip, share of the way between them."""

_SLANT = 0.08
"""Largest part of it, forwards or backwards, that the middle of the stance may have."""


@dataclass(frozen=True)
class Gait:
    """A symmetric gait.

    Attributes:
        name: of the clip.
        footfalls: phase in [0, 1) at which the front left, front right, hind left and hind right foot come down.
        duty: share of the stride that a foot is on the ground.
        step: way of a standing foot, hip heights.
        period: of a stride, in sqrt(hip height / g).
        lift: height of a lifted foot, hip heights.
        bob: how far the body goes up and down twice a stride beyond what the legs ask for, hip heights.
        vault: how far it follows the legs that carry it, see :func:`fauna.export.stance.settle`.
        nod_deg: the same of the neck.
        sway_deg: how far spine and tail go sideways once a stride.
        frames: intervals of a stride; a multiple of what makes footfalls and lift-offs frames.
    """

    name: str
    footfalls: tuple[float, float, float, float]
    duty: float
    step: float
    period: float
    lift: float
    bob: float
    vault: float
    nod_deg: float
    sway_deg: float
    frames: int


WALK = Gait(
    name="walk",
    footfalls=(0.25, 0.75, 0.0, 0.5),  # lateral sequence: hind left, front left, hind right, front right
    duty=0.65,
    step=0.42,
    period=2.9,
    lift=0.10,
    bob=0.0,
    vault=0.85,
    nod_deg=2.5,
    sway_deg=2.0,
    frames=40,
)
TROT = Gait(
    name="trot",
    footfalls=(0.5, 0.0, 0.0, 0.5),  # diagonal pairs: hind left with front right, hind right with front left
    duty=0.475,
    step=0.42,
    period=1.9,
    lift=0.15,
    bob=0.022,
    vault=0.0,
    nod_deg=1.0,
    sway_deg=1.0,
    frames=40,
)


def stands(leg: Leg) -> Float[np.ndarray, " 3"]:
    """Where a foot stands: on the ground below its place at rest, not too far before or behind its hip."""
    limit = _SLANT * leg.length
    slant = float(np.clip(leg.sole[2] - leg.hip[2], -limit, limit))
    return np.array([leg.sole[0], 0.0, leg.hip[2] + slant])


def step_length(gait: Gait, stance: Stance) -> float:
    """Way of a standing foot that all grounded legs can make, metres."""
    apart = [abs((stands(leg) + leg.ankle_over_sole - leg.hip)[2]) for leg in stance.standing]
    room = [max(_SPREAD * leg.reach - each, 0.0) for leg, each in zip(stance.standing, apart, strict=True)]
    return min([gait.step * stance.hip_height, *(2.0 * each for each in room)])


def footfalls_of(gait: Gait, stance: Stance) -> tuple[float, ...]:
    """When each foot comes down; legs that lie in each other together."""
    return tuple(gait.footfalls[leg] for leg in stance.follows)


def strides(gait: Gait, stance: Stance, step: float) -> tuple[Steps, ...]:
    """The way of every foot through a stride, the first frame again at its end."""
    lift, feet = gait.lift * stance.hip_height, []
    for leg, footfall, grounded, followed in zip(
        stance.legs, footfalls_of(gait, stance), stance.grounded, stance.follows, strict=True
    ):
        offsets, share = _path(gait, footfall, step)
        places = stands(leg) + np.outer(share, (0.0, lift, 0.0)) + np.outer(offsets, (0.0, 0.0, 1.0))
        feet.append(Steps(leg, places, share, grounded, stance.legs[followed].joints.front))
    return tuple(feet)


def _path(gait: Gait, footfall: float, step: float) -> tuple[Float[np.ndarray, " frame"], Float[np.ndarray, " frame"]]:
    """Place along z and share of the lift.

    On the ground a foot goes backwards at one speed; in the air a cubic takes it to the front, as fast at both ends.
    """
    phase = (np.arange(gait.frames + 1) / gait.frames - footfall) % 1.0
    phase = np.where(phase > 1.0 - 1e-9, 0.0, phase)
    swing = ((phase - gait.duty) / (1.0 - gait.duty)).clip(0.0, 1.0)
    slope = -step * (1.0 - gait.duty) / gait.duty
    air = step * (-2.0 * swing**3 + 3.0 * swing**2 - 0.5) + slope * (2.0 * swing**3 - 3.0 * swing**2 + swing)
    in_air = phase > gait.duty + 1e-9
    offsets = np.where(in_air, air, step * (0.5 - phase / gait.duty))
    return offsets, np.where(in_air, np.sin(np.pi * swing) ** 2, 0.0)


def stands_still(stance: Stance, frames: int) -> tuple[Steps, ...]:
    """Feet that stay where they are."""
    return tuple(
        Steps(leg, np.tile(stands(leg), (frames, 1)), np.zeros(frames), grounded, stance.legs[followed].joints.front)
        for leg, grounded, followed in zip(stance.legs, stance.grounded, stance.follows, strict=True)
    )
