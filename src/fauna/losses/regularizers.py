"""Magnitude regularisers (R_art and R_def, supplement) The Eikonal term lives with the signed distance field."""

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
