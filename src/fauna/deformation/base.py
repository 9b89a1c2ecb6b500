"""The interface of instance deformations."""

from abc import ABC, abstractmethod

from jaxtyping import Float
from torch import Tensor, nn

from fauna.types import BaseShape, InstanceShape


class Deformation(nn.Module, ABC):
    """Fits the base shape to a photo (Sec. 3.1, "Implementation Details").

    Attributes:
        turned: learned with the head at -z, see :mod:`fauna.geometry.half_turn`.
    """

    turned: bool = False

    @abstractmethod
    def forward(self, base: BaseShape, geometry: Float[Tensor, "batch geometry_chan"]) -> InstanceShape:
        """Rest mesh of each photo.

        Args:
            base: rest mesh shared by the batch.
            geometry: geometry embedding of each photo.
        """
