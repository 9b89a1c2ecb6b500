"""What a base shape has to offer."""

from abc import ABC, abstractmethod

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fauna.geometry.half_turn import half_turn
from fauna.geometry.sparse_extraction import ExtractionStats
from fauna.types import BaseShape


class Shape(nn.Module, ABC):
    """Turns a shape code into the rest mesh of a species or photo.

    Attributes:
        grid_resolution: current resolution in the paper's units; change it with :meth:`set_resolution`.
        turned: learned with the head at -z, see :mod:`fauna.geometry.half_turn`.
    """

    grid_resolution: int
    turned: bool = False

    def forward(self, embedding: Float[Tensor, " value_chan"], generator: torch.Generator | None) -> BaseShape:
        """Rest mesh of a shape code.

        Args:
            embedding: shape code.
            generator: source of the lattice jitter; ``None`` means no jitter.
        """
        base = self.extract(embedding, generator)[0]
        return BaseShape(half_turn(base.verts), base.faces) if self.turned else base

    @abstractmethod
    def extract(
        self, embedding: Float[Tensor, " value_chan"], generator: torch.Generator | None
    ) -> tuple[BaseShape, ExtractionStats]:
        """The rest mesh in the frame it was learned in, and what it cost."""

    @abstractmethod
    def eikonal(
        self, embedding: Float[Tensor, " value_chan"], base: BaseShape, generator: torch.Generator
    ) -> Float[Tensor, ""]:
        """Mean squared deviation of the signed distance's gradient norm from 1; the code gets no gradient."""

    @abstractmethod
    def set_resolution(self, grid_resolution: int) -> None:
        """Change the resolution from the next mesh on."""

    @abstractmethod
    def audit(self, embedding: Float[Tensor, " value_chan"], generator: torch.Generator | None) -> int:
        """Number of mesh components that a more careful extraction finds in addition."""
