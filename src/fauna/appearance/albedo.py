"""Albedo field (Sec. 3.1, "Appearance")."""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from fauna.networks import CoordMLP
from fauna.precision import Precision


class AlbedoField(nn.Module):
    """Colour of a point of the base shape, ``sigmoid(MLP(|x|, y, z; texture embedding))``.

    Args:
        texture_dim: width of the texture embedding.
        num_octaves: octaves of the harmonic embedding.
        base_frequency: its lowest frequency, radians per world unit.
        num_layers: linear layers behind the input layer.
        hidden_dim: width of the hidden layers.
        precision: of its matrix products.
    """

    def __init__(
        self,
        *,
        texture_dim: int,
        num_octaves: int,
        base_frequency: float,
        num_layers: int,
        hidden_dim: int,
        precision: Precision,
    ) -> None:
        super().__init__()
        self.field = CoordMLP(
            num_octaves=num_octaves,
            base_frequency=base_frequency,
            condition_dim=texture_dim,
            out_dim=3,
            num_layers=num_layers,
            hidden_dim=hidden_dim,
            precision=precision,
        )

    def forward(
        self,
        points: Float[Tensor, "point 3"],
        texture: Float[Tensor, "row texture_chan"],
        row: Int[Tensor, " point"],
    ) -> Float[Tensor, "point 3"]:
        """RGB in [0, 1] at canonical points; ``row`` says whose texture each point has."""
        return self.field(mirror_to_right(points), texture, row).sigmoid()


def mirror_to_right(points: Float[Tensor, "point 3"]) -> Float[Tensor, "point 3"]:
    """(|x|, y, z): the input of every field that is the same on both sides of the body."""
    x, y, z = points.unbind(-1)
    return torch.stack((x.abs(), y, z), dim=-1)
