"""Mask discriminator (Sec. 3.2, "Mask Discriminator", and its details in the supplement)."""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from fauna.errors import FaunaError

_SLOPE = 0.2


class MaskDiscriminator(nn.Module):
    """Tells observed masks from rendered ones, given the shape code.

    4x4/2 convolutions without bias or normalisation, LeakyReLU(0.2), doubling channels from ``base_channels`` until
    the map is smaller than 8, then one convolution over what is left. The code is a constant image beside the mask; its
    share of the first layer is computed without building that image.

    Args:
        condition_dim: width of the shape code.
        image_size: side of the masks; 256, 128 and 64 end at 4 x 4, 96 at 6 x 6.
        base_channels: channels behind the first layer.

    Raises:
        FaunaError: when the masks cannot be halved often enough.
    """

    def __init__(self, *, condition_dim: int, image_size: int, base_channels: int) -> None:
        super().__init__()
        halvings = (max(image_size, 1) // 4).bit_length() - 1
        if halvings < 1 or image_size % 2**halvings:
            raise FaunaError(
                f"discriminator.image_size must be 4..7 times a power of two, got {image_size}; use 64, 96, 128 or 256"
            )
        self.image_size = image_size
        dims = [base_channels * 2**level for level in range(halvings)]
        self.first = _halve(1 + condition_dim, base_channels)
        self.layers = nn.ModuleList(_halve(a, b) for a, b in zip(dims[:-1], dims[1:], strict=True))
        self.logit = nn.Conv2d(dims[-1], 1, image_size >> halvings, bias=False)

    def forward(
        self,
        masks: Float[Tensor, "batch height width"],
        condition: Float[Tensor, " value_chan"] | Float[Tensor, "batch value_chan"],
    ) -> Float[Tensor, " batch"]:
        """One logit per mask, positive for "observed".

        Args:
            masks: in [0, 1].
            condition: shape code, of each mask or one for all.

        Raises:
            FaunaError: when the masks have another size than the network.
        """
        height, width = masks.shape[-2:]
        if (height, width) != (self.image_size, self.image_size):
            raise FaunaError(
                f"discriminator expects {self.image_size}x{self.image_size} masks, got {height}x{width}; "
                "set discriminator.image_size to the render size"
            )
        hidden = F.leaky_relu(self._first(masks, condition.reshape(-1, condition.shape[-1])), _SLOPE)
        for layer in self.layers:
            hidden = F.leaky_relu(layer(hidden), _SLOPE)
        return self.logit(hidden).flatten()

    def _first(self, masks: Tensor, condition: Float[Tensor, "group value_chan"]) -> Tensor:
        """First layer on [mask, constant code]: by linearity the code becomes a kernel over an image of ones."""
        weight = self.first.weight
        of_mask = F.conv2d(masks[:, None], weight[:, :1], stride=2, padding=1)
        kernels = torch.einsum("ocij,gc->goij", weight[:, 1:], condition).flatten(0, 1)[:, None]
        of_code = F.conv2d(torch.ones_like(masks[:1, None]), kernels, stride=2, padding=1)
        return of_mask + of_code.reshape(condition.shape[0], -1, *of_mask.shape[-2:])


def _halve(in_dim: int, out_dim: int) -> nn.Conv2d:
    """4x4 convolution with stride 2."""
    return nn.Conv2d(in_dim, out_dim, 4, stride=2, padding=1, bias=False)
