"""What the networks are told about the photo's mask, beside frozen features that are coarser than a leg."""

from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from fauna.types import Features


class NoMaskEmbedding(nn.Module):
    """The paper: networks see the frozen features only."""

    def forward(self, features: Features, masks: Float[Tensor, "batch height width"]) -> Features:
        """The features as they are."""
        return features


class MaskEmbedding(nn.Module):
    """Adds a learned projection of the mask, ``subcells`` x ``subcells`` values in each feature cell, to the keys.

    Viewpoint, articulation and deformation read keys, so they see the outline; the bank and the texture do not. The mask
    is an input of the method anyway: it made the crop.

    Args:
        key_dim: channels of the key map.
        subcells: mask values per feature cell and axis.
    """

    def __init__(self, *, key_dim: int, subcells: int) -> None:
        super().__init__()
        self.subcells = subcells
        self.project = nn.Conv2d(subcells**2, key_dim, 1, bias=False)
        nn.init.normal_(self.project.weight, std=2.0 / subcells)

    def forward(self, features: Features, masks: Float[Tensor, "batch height width"]) -> Features:
        """Features whose keys carry the mask, area-averaged to ``subcells`` times the grid."""
        height, width = (side * self.subcells for side in features.keys.shape[-2:])
        centred = masks[:, None] - 0.5
        if masks.shape[-2:] != (height, width):
            centred = F.adaptive_avg_pool2d(centred, (height, width))
        keys = features.keys + self.project(F.pixel_unshuffle(centred, self.subcells))
        return Features(features.global_, features.tokens, keys)
