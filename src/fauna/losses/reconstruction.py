"""Image-space losses, one value per rendered row (Sec. 3.2 of the paper, "Reconstruction Losses").

Every function returns a mean over all pixels (and channels) of the image, never normalised by mask area.
Shapes: silhouettes and masks (row, height, width); images (row, chan, height, width).
"""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

Silhouette = Float[Tensor, "row height width"]
Image = Float[Tensor, "row chan height width"]
PerRow = Float[Tensor, " row"]


def mask_loss(silhouette: Silhouette, mask: Silhouette, valid: Silhouette) -> PerRow:
    """Mean squared difference; pixels from outside the photo count as background of the silhouette."""
    return (silhouette * valid - mask).square().mean(dim=(1, 2))


def mask_spill_loss(silhouette: Silhouette, distance_outside: Silhouette) -> PerRow:
    """Silhouette outside the mask, weighted by its distance to the mask: the distance term of the paper's L_m."""
    return (silhouette * distance_outside).mean(dim=(1, 2))


def mask_miss_loss(silhouette: Silhouette, distance_inside: Silhouette) -> PerRow:
    """Missing silhouette inside the mask, weighted by depth inside it: the distance term of the published runs."""
    return ((1.0 - silhouette) * distance_inside).mean(dim=(1, 2))


@torch.no_grad()
def eroded_intersection(silhouette: Silhouette, mask: Silhouette, valid: Silhouette) -> Silhouette:
    """Binary intersection of silhouette and mask, eroded by one pixel; without gradient.

    A pixel survives when its whole 3 x 3 neighbourhood (zero outside the image) lies in the intersection.
    """
    both = ((silhouette * valid > 0) & (mask > 0.5)).to(silhouette.dtype)
    return (F.avg_pool2d(both[:, None], 3, stride=1, padding=1)[:, 0] > 0.99).to(silhouette.dtype)


def image_loss(rgb: Image, image: Image, region: Silhouette) -> PerRow:
    """Mean absolute colour difference inside ``region`` (L_im)."""
    return ((rgb - image).abs() * region[:, None]).mean(dim=(1, 2, 3))


def feature_loss(rendered: Image, target: Image, region: Silhouette) -> PerRow:
    """Mean squared feature difference inside ``region`` (L_feat)."""
    return ((rendered - target).square() * region[:, None]).mean(dim=(1, 2, 3))


def upsample(
    maps: Float[Tensor, "row chan grid_height grid_width"], height: int, width: int
) -> Float[Tensor, "row chan {height} {width}"]:
    """Bilinear resize of feature maps to the render resolution (pixel centres aligned, ``align_corners=False``)."""
    if maps.shape[-2:] == (height, width):
        return maps
    return F.interpolate(maps, size=(height, width), mode="bilinear", align_corners=False)
