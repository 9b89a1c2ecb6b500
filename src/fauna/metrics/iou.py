"""Silhouette intersection over union."""

import torch
from jaxtyping import Float
from torch import Tensor


@torch.no_grad()
def silhouette_iou(
    silhouette: Float[Tensor, "row height width"], mask: Float[Tensor, "row height width"]
) -> Float[Tensor, " row"]:
    """IoU of the images thresholded at one half; 1 where both are empty.

    >>> silhouette_iou(torch.ones(1, 2, 2), torch.tensor([[[1.0, 1.0], [0.0, 0.0]]])).item()
    0.5
    """
    first, second = silhouette > 0.5, mask > 0.5
    union = (first | second).sum(dim=(1, 2))
    both = (first & second).sum(dim=(1, 2))
    return torch.where(union == 0, 1.0, both / union.clamp_min(1))
