"""Magnitude regularisers (R_art and R_def, supplement). The Eikonal term lives with the signed distance field."""

from typing import Literal

from jaxtyping import Float
from torch import Tensor


def articulation_loss(angles: Float[Tensor, "row bone 3"], norm: Literal["vector", "component"]) -> Float[Tensor, ""]:
    """Mean squared bone angle, rad^2.

    ``vector``: mean over bones of the squared norm of the three angles (the paper's R_art);
    ``component``: mean over all components, a third of it (the published code).
    """
    squared = angles.square()
    return squared.sum(dim=-1).mean() if norm == "vector" else squared.mean()


def deformation_loss(offsets: Float[Tensor, "batch vert 3"]) -> Float[Tensor, ""]:
    """Mean squared component of the vertex offsets, world units squared (R_def)."""
    return offsets.square().mean()


SIDE_SPREAD = 0.35
"""Of the prior for views from the side: sine of 20 degrees."""


def side_view_loss(rotations: Float[Tensor, "row 3 3"]) -> Float[Tensor, " row"]:
    """``1 - exp(-f^2 / (2 s^2))`` with ``f`` the part of the animal's forward axis along the optical axis, ``s`` = :data:`SIDE_SPREAD`.

    Not in the paper. How long a body is and how far it is turned are one thing to a silhouette, and no view shows a body longer than
    the one from the side; so the longest-looking individuals decide the length and all others seem turned away. Among
    the explanations that fit alike this prefers the one from the side. Its pull is strongest 20 degrees from there, half of that at 40
    and a tenth at 60 degrees.

    Args:
        rotations: camera_from_world.
    """
    along = rotations[:, 2, 2]
    return 1.0 - (-along.square() / (2.0 * SIDE_SPREAD**2)).exp()
