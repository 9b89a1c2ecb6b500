"""A random two-layer convolutional encoder: no weights to fetch, fast, for tests and smoke runs only."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fauna.encoder.base import Encoder
from fauna.types import Features


class TinyEncoder(Encoder):
    """Tokens = keys = a seeded random convolution of the image; global = its mean.

    Args:
        input_size: image side in pixels, a multiple of ``stride``.
        stride: pixels per grid cell.
        token_dim: channels of the map and of the global vector.
        seed: of the random weights.
    """

    keys_are_tokens = True

    def __init__(self, *, input_size: int, stride: int, token_dim: int, seed: int):
        generator = torch.Generator().manual_seed(seed)
        network = nn.Sequential(
            nn.Conv2d(3, token_dim, stride, stride), nn.Tanh(), nn.Conv2d(token_dim, token_dim, 3, padding=1), nn.Tanh()
        )
        for parameter in network.parameters():
            fan_in = parameter[0].numel()
            nn.init.normal_(parameter, std=fan_in**-0.5, generator=generator)
        super().__init__(
            name="tiny",
            network=network,
            input_size=input_size,
            stride=stride,
            global_dim=token_dim,
            token_dim=token_dim,
            settings="v1",
        )

    def _encode(self, images: Float[Tensor, "batch 3 height width"]) -> Features:
        tokens = self.network(images * 2 - 1)
        return Features(global_=tokens.mean(dim=(2, 3)), tokens=tokens, keys=tokens)
