"""Cutting a crop out of a photograph: the same for files of datasets and photographs in memory."""

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image

from fauna.data.crop_box import CropBox
from fauna.data.crop_window import crop_window

Cut = tuple[UInt8[np.ndarray, "size size 3"], Bool[np.ndarray, "size size"], CropBox]


def mask_window(mask: Bool[np.ndarray, "height width"]) -> tuple[int, int, int]:
    """Left, top and side of the square window that the shared rule gives a mask, which is not empty."""
    rows, columns = np.nonzero(mask)
    centroid = (float(columns.mean()) + 0.5, float(rows.mean()) + 0.5)
    bounds = (float(columns.min()), float(rows.min()), columns.max() + 1.0, rows.max() + 1.0)
    return crop_window(float(len(rows)), centroid, bounds)


def cut(
    photograph: Image.Image, mask: Bool[np.ndarray, "height width"], window: tuple[int, int, int], size: int
) -> Cut:
    """Image, mask and place of a crop.

    Args:
        photograph: RGB.
        mask: of the animal.
        window: left, top, side in pixels of the photograph; black and background beyond it.
        size: side of the crop, pixels.
    """
    left, top, side = window
    place = (left, top, left + side, top + side)
    image = photograph.crop(place).resize((size, size), Image.Resampling.BILINEAR)
    share = Image.fromarray(mask.astype(np.float32)).crop(place).resize((size, size), Image.Resampling.BOX)
    height, width = mask.shape
    return np.array(image), np.array(share) >= 0.5, CropBox(left, top, side, side, width, height)
