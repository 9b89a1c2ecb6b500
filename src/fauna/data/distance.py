"""Exact Euclidean distance maps of masks (3D-Fauna, mask loss with distance transform)."""

import numpy as np
import torch
from jaxtyping import Float
from scipy.ndimage import distance_transform_edt
from torch import Tensor


def distance_maps(
    mask: Float[Tensor, "height width"],
) -> tuple[Float[Tensor, "height width"], Float[Tensor, "height width"]]:
    """Distance of each pixel centre to the nearest centre of the other kind, in image widths.

    Args:
        mask: (height, width), above one half is foreground.

    Returns:
        inside: distance of foreground pixels to the background, 0 on the background.
        outside: distance of background pixels to the foreground, 0 on the foreground.
        A kind that does not occur counts as one image width away.
    """
    foreground = mask.numpy() > 0.5
    return _distance(foreground), _distance(~foreground)


def _distance(region: np.ndarray) -> Float[Tensor, "height width"]:
    """Distance of pixels in the region to its complement."""
    if region.all():
        return torch.ones(region.shape)
    return torch.from_numpy(distance_transform_edt(region) / region.shape[1]).float()
