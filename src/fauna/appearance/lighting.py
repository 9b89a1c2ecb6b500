"""Light of a photo (Sec. 3.1, "Appearance"; ranges in Tab. 6)."""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from fauna.networks import MLP
from fauna.types import Light


class LightNetwork(nn.Module):
    """Texture embedding -> one directional light from above and an ambient term, in the camera frame.

    Args:
        texture_dim: width of the texture embedding.
        num_layers: number of linear layers.
        hidden_dim: width of the hidden layers.
    """

    def __init__(self, *, texture_dim: int, num_layers: int, hidden_dim: int) -> None:
        super().__init__()
        self.mlp = MLP(in_dim=texture_dim, out_dim=4, num_layers=num_layers, hidden_dim=hidden_dim)

    def forward(self, texture: Float[Tensor, "row texture_chan"]) -> Light:
        """Direction ``normalise(2a - 1, 0.5, 2b - 1)``, ambient c in [0, 1], diffuse 0.5 + 0.5 d in [0.5, 1]."""
        a, b, ambient, diffuse = self.mlp(texture).sigmoid().unbind(-1)
        direction = torch.stack((2 * a - 1, torch.full_like(a, 0.5), 2 * b - 1), dim=-1)
        return Light(F.normalize(direction, dim=-1), ambient, 0.5 + 0.5 * diffuse)
