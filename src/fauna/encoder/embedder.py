"""Learned heads on frozen feature maps: small convolutional trunks and the image embeddings (Sec. 3.1)."""

from dataclasses import dataclass
from typing import Literal

from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from fauna.errors import FaunaError
from fauna.types import Features, ImageEmbedding

_LIGHT_GRID = 4
_PAPER_MAP = 32


@dataclass(frozen=True)
class TrunkOptions:
    """Shape of a :class:`ConvTrunk`.

    Attributes:
        variant: ``paper`` (for 32 x 32 maps) or ``light`` (any map from 8 x 8).
        hidden_dim: channels of the strided convolutions.
        channels_per_group: of the group normalisation; must divide ``hidden_dim``.
        reduce_dim: channels the map is projected to first; ``light`` only.
    """

    variant: Literal["paper", "light"]
    hidden_dim: int
    channels_per_group: int
    reduce_dim: int | None

    def __post_init__(self) -> None:
        if self.variant not in ("paper", "light"):
            raise FaunaError(f"trunk.variant must be paper or light, got {self.variant!r}; choose one")
        if self.hidden_dim % self.channels_per_group:
            raise FaunaError(
                f"trunk.hidden_dim must be a multiple of channels_per_group, got {self.hidden_dim} and "
                f"{self.channels_per_group}; change one of them"
            )
        if (self.variant == "light") != (self.reduce_dim is not None):
            raise FaunaError(
                f"trunk.reduce_dim belongs to variant=light only, got {self.reduce_dim} with {self.variant}; "
                "set a width for light, null for paper"
            )


class ConvTrunk(nn.Module):
    """Feature map -> vector.

    ``paper``: three 4x4/2 convolutions, each followed by group norm and LeakyReLU(0.2), then a 4x4 layer over
    the remaining 4 x 4 cells, all without bias; fits 32 x 32 maps only.
    ``light``: a 1x1 projection, two such convolutions, average pooling to 4 x 4 cells (none left to pool for
    16 x 16 maps) and one linear layer; about a tenth of the cost, for any map from 8 x 8.

    Args:
        in_dim: channels of the map.
        out_dim: width of the vector.
        options: the sizes.
    """

    def __init__(self, *, in_dim: int, out_dim: int, options: TrunkOptions) -> None:
        super().__init__()
        self.variant = options.variant
        hidden = options.hidden_dim
        groups = hidden // options.channels_per_group
        if options.reduce_dim is None:
            self.layers = nn.Sequential(
                _halve(in_dim, hidden, groups),
                _halve(hidden, hidden, groups),
                _halve(hidden, hidden, groups),
                nn.Conv2d(hidden, out_dim, 4, bias=False),
                nn.Flatten(),
            )
        else:
            self.layers = nn.Sequential(
                nn.Conv2d(in_dim, options.reduce_dim, 1),
                _halve(options.reduce_dim, hidden, groups),
                _halve(hidden, hidden, groups),
                nn.AdaptiveAvgPool2d(_LIGHT_GRID),
                nn.Flatten(),
                nn.Linear(hidden * _LIGHT_GRID**2, out_dim),
            )

    def forward(self, feature_map: Float[Tensor, "batch chan height width"]) -> Float[Tensor, "batch out_dim"]:
        """Summarise a map.

        Raises:
            FaunaError: when the map is too small.
        """
        height, width = feature_map.shape[-2:]
        if min(height, width) < 8:
            raise FaunaError(f"trunk expects feature maps from 8x8, got {height}x{width}; raise encoder.input_size")
        if self.variant == "paper" and (height, width) != (_PAPER_MAP, _PAPER_MAP):
            feature_map = F.interpolate(feature_map, (_PAPER_MAP, _PAPER_MAP), mode="bilinear", align_corners=False)
        return self.layers(feature_map)


def _halve(in_dim: int, out_dim: int, groups: int) -> nn.Sequential:
    """4x4 convolution with stride 2, group norm, LeakyReLU."""
    conv = nn.Conv2d(in_dim, out_dim, 4, stride=2, padding=1, bias=False)
    return nn.Sequential(conv, nn.GroupNorm(groups, out_dim), nn.LeakyReLU(0.2))


class ImageEmbedder(nn.Module):
    """Two learned embeddings of a photo: texture from patch tokens, geometry from attention keys.

    Args:
        token_dim: channels of the token map.
        key_dim: channels of the key map.
        embedding_dim: width of each embedding.
        trunk: shape of both trunks.
        normalize: end each with a layer norm, which keeps small embeddings from drowning beside position codes.
    """

    def __init__(
        self, *, token_dim: int, key_dim: int, embedding_dim: int, trunk: TrunkOptions, normalize: bool
    ) -> None:
        super().__init__()
        self.embedding_dim = embedding_dim
        self.texture = ConvTrunk(in_dim=token_dim, out_dim=embedding_dim, options=trunk)
        self.geometry = ConvTrunk(in_dim=key_dim, out_dim=embedding_dim, options=trunk)
        self.texture_norm = nn.LayerNorm(embedding_dim) if normalize else nn.Identity()
        self.geometry_norm = nn.LayerNorm(embedding_dim) if normalize else nn.Identity()

    def forward(self, features: Features) -> ImageEmbedding:
        """Embed every photo."""
        texture = self.texture_norm(self.texture(features.tokens))
        return ImageEmbedding(texture, self.geometry_norm(self.geometry(features.keys)))
