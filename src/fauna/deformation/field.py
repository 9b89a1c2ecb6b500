"""Instance deformation as a field over the base shape (Sec. 3.1, "Implementation Details")."""

import torch
from jaxtyping import Float
from torch import Tensor

from fauna.deformation.base import Deformation
from fauna.geometry.half_turn import half_turn
from fauna.networks import CoordMLP
from fauna.precision import Precision
from fauna.types import BaseShape, InstanceShape


class DeformationField(Deformation):
    """Vertex offsets ``offset_scale * MLP(|x|, y, z; geometry embedding)``.

    Args:
        geometry_dim: width of the geometry embedding.
        num_octaves: octaves of the harmonic embedding.
        base_frequency: its lowest frequency, radians per world unit.
        num_layers: linear layers behind the input layer.
        hidden_dim: width of the hidden layers.
        precision: of its matrix products.
        offset_scale: factor on the output, world units.
        mirror_x: the x offset changes sign with x, so that instances stay mirror-symmetric (the paper's "bilateral
            symmetry"); ``False`` shifts both sides the same way, as the published code does.
    """

    def __init__(
        self,
        *,
        geometry_dim: int,
        num_octaves: int,
        base_frequency: float,
        num_layers: int,
        hidden_dim: int,
        precision: Precision,
        offset_scale: float,
        mirror_x: bool,
    ) -> None:
        super().__init__()
        self.offset_scale = offset_scale
        self.mirror_x = mirror_x
        self.field = CoordMLP(
            num_octaves=num_octaves,
            base_frequency=base_frequency,
            condition_dim=geometry_dim,
            out_dim=3,
            num_layers=num_layers,
            hidden_dim=hidden_dim,
            precision=precision,
        )

    def forward(self, base: BaseShape, geometry: Float[Tensor, "batch geometry_chan"]) -> InstanceShape:
        """Offset every vertex of the base for every photo."""
        x, y, z = half_turn(base.verts, self.turned).unbind(-1)
        points = torch.stack((x.abs(), y, z), dim=-1)
        offsets = self.field.grid(points, geometry) * self.offset_scale
        if self.mirror_x:
            side = x.detach().sign()
            offsets = offsets * torch.stack((side, torch.ones_like(side), torch.ones_like(side)), dim=-1)
        offsets = half_turn(offsets, self.turned)
        return InstanceShape(base.verts + offsets, offsets)
