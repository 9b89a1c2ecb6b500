"""No instance deformation."""

from jaxtyping import Float
from torch import Tensor

from fauna.deformation.base import Deformation
from fauna.types import BaseShape, InstanceShape


class NoDeformation(Deformation):
    """Every photo shares the base shape."""

    def forward(self, base: BaseShape, geometry: Float[Tensor, "batch geometry_chan"]) -> InstanceShape:
        """The base with a leading axis of 1 and without offsets."""
        return InstanceShape(base.verts[None])
