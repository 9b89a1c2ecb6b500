"""Fixed four-legged template: a baseline and a stand-in wherever the shape need not be learned."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fauna.geometry.lattice import BCCLattice
from fauna.geometry.sparse_extraction import ExtractionStats, extract_sparse
from fauna.shape.base import Shape
from fauna.types import BaseShape


class TemplateShape(Shape):
    """Ellipsoid with four stub legs, the same for every shape code; the Eikonal term is 0.

    Args:
        radii: semi-axes of the body along x, y, z, world units.
        leg_length: how far the feet reach below the body's centre, world units.
        leg_radius: of a leg, world units.
        cell_size: of the lattice the template is meshed on, world units.
        learnable_scale: whether a factor per axis, initially 1, is a parameter.
    """

    def __init__(
        self,
        *,
        radii: Sequence[float],
        leg_length: float,
        leg_radius: float,
        cell_size: float,
        learnable_scale: bool,
    ) -> None:
        super().__init__()
        body = torch.tensor(list(radii), dtype=torch.float32)
        axes = body.min() / body
        hips = torch.tensor((body[0] / 2, 0.0, 0.6 * body[2]))

        def signed_distance(points: Tensor) -> Tensor:
            trunk = body.min() - (points * axes).norm(dim=1)
            folded = torch.stack((points[:, 0].abs(), points[:, 1], points[:, 2].abs()), dim=1) - hips
            along = folded[:, 1] - folded[:, 1].clamp(leg_radius - leg_length, 0.0)
            leg = leg_radius - torch.stack((folded[:, 0], along, folded[:, 2]), dim=1).norm(dim=1)
            return torch.maximum(trunk, leg)

        half = (body.amax() + leg_length).item()
        lattice = BCCLattice(cell_size=cell_size, half_extents=(half, half, half))
        verts, faces, stats = extract_sparse(signed_distance, lattice, torch.zeros(3), lipschitz=1.0, coarse_cells=8)
        self.grid_resolution = 0
        self.stats = stats
        self.log_scale = nn.Parameter(torch.zeros(3), requires_grad=learnable_scale)
        self.verts: Tensor
        self.faces: Tensor
        self.register_buffer("verts", verts, persistent=False)
        self.register_buffer("faces", faces, persistent=False)

    def extract(
        self, embedding: Float[Tensor, " value_chan"], generator: torch.Generator | None
    ) -> tuple[BaseShape, ExtractionStats]:
        """The template; ``embedding`` and ``generator`` do not matter."""
        return BaseShape(self.verts * self.log_scale.exp(), self.faces), self.stats

    def eikonal(
        self, embedding: Float[Tensor, " value_chan"], base: BaseShape, generator: torch.Generator
    ) -> Float[Tensor, ""]:
        """Zero: there is no signed distance to regularise."""
        return base.verts.new_zeros(())

    def set_resolution(self, grid_resolution: int) -> None:
        """Accept the schedule of learned shapes; the template does not change."""
        self.grid_resolution = grid_resolution

    def audit(self, embedding: Float[Tensor, " value_chan"], generator: torch.Generator | None) -> int:
        """Zero: the template is one component."""
        return 0
