"""Limits of the bone angles (supplement, "Bone Rotation Constraints").

Columns are (swing, sideways, twist), see "Bone rotation" in ``docs/conventions.md``; legs may always swing freely.
"""

import math
from collections.abc import Callable, Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from fauna.errors import FaunaError
from fauna.geometry.skeleton import BONES_PER_LEG, NUM_BODY_BONES, NUM_BONES

_FEET = slice(NUM_BODY_BONES, NUM_BONES, BONES_PER_LEG)
_UPPER = slice(NUM_BODY_BONES + 2, NUM_BONES, BONES_PER_LEG)
_LEGS = slice(NUM_BODY_BONES, NUM_BONES)
_SIDEWAYS_AND_TWIST = slice(1, 3)

Limits = Float[Tensor, "20 3"]


def early(limits: Limits) -> Limits:
    """First phase of the published training: legs go sideways and twist by 0.3 of the full range."""
    limits = limits.clone()
    limits[_LEGS, _SIDEWAYS_AND_TWIST] *= 0.3
    return limits


def paper(limits: Limits) -> Limits:
    """The paper: upper leg segments go sideways and twist within 10 degrees, the lower two only swing."""
    limits = limits.clone()
    limits[_LEGS, _SIDEWAYS_AND_TWIST] = 0.0
    limits[_UPPER, _SIDEWAYS_AND_TWIST] = math.radians(10.0)
    return limits


def released(limits: Limits) -> Limits:
    """The published checkpoint: FOOT segments go sideways and twist by 0.05 of the range, the others only swing."""
    limits = limits.clone()
    limits[_LEGS, _SIDEWAYS_AND_TWIST] = 0.0
    limits[_FEET, _SIDEWAYS_AND_TWIST] = 0.05 * limits[_FEET, :1]
    return limits


LEG_LIMITS: Mapping[str, Callable[[Limits], Limits]] = {"early": early, "paper": paper, "released": released}
"""Limits of the legs, by the name used in ``schedule.leg_limits``."""


def angle_limits(leg_limits: str, *, max_angle_deg: float, body_sideways_deg: float, body_twist_deg: float) -> Limits:
    """Largest absolute angle of every bone about every axis, radians.

    Args:
        leg_limits: a name of :data:`LEG_LIMITS`.
        max_angle_deg: limit of everything that is not limited further.
        body_sideways_deg: limit of the sideways bend of spine bones (paper: none of its own).
        body_twist_deg: limit of the twist of spine bones.

    Raises:
        FaunaError: for an unknown name.
    """
    if leg_limits not in LEG_LIMITS:
        raise FaunaError(
            f"schedule.leg_limits must name one of {', '.join(LEG_LIMITS)}, got {leg_limits!r}; correct the name"
        )
    limits = LEG_LIMITS[leg_limits](torch.full((NUM_BONES, 3), math.radians(max_angle_deg)))
    limits[:NUM_BODY_BONES, 1] = math.radians(body_sideways_deg)
    limits[:NUM_BODY_BONES, 2] = math.radians(body_twist_deg)
    return limits.clamp(max=math.radians(max_angle_deg))
