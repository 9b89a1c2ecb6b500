"""What is measured of a crop before it is used or rejected: pure functions of pixels."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from fauna.masks.animals import connected, extent, touched_border

INSIDE = 3
"""Pixels by which a mask is shrunk before sharpness is measured: the outline is no texture of the animal."""


@dataclass(frozen=True)
class Measures:
    """Of one animal.

    Attributes:
        extent: longer side of the mask's bounding box, pixels of the photograph at full size.
        sharpness: see :func:`sharpness`.
        fill: share of the crop that is animal.
        truncation: share of the bounding box's circumference that lies on the photograph's border.
        occlusion: share of the mask that is not in its largest connected part.
        parts: connected parts that are not specks.
    """

    extent: float
    sharpness: float
    fill: float
    truncation: float
    occlusion: float
    parts: int


def measure(
    image: UInt8[np.ndarray, "side side 3"],
    crop_mask: Bool[np.ndarray, "side side"],
    mask: Bool[np.ndarray, "height width"],
    *,
    scale: float,
    speck_share: float,
    border: float,
) -> Measures:
    """Measure an animal.

    Args:
        image: its crop.
        crop_mask: of the crop, not empty.
        mask: of the photograph at working size, not empty.
        scale: pixels of the photograph at full size per pixel of ``mask``.
        speck_share: parts smaller than this share of the mask are not counted.
        border: width of the strip that counts as the photograph's border, shares of its longer side.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    window = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    largest, parts = in_parts(mask[window], speck_share)
    return Measures(
        extent=extent(mask) * scale,
        sharpness=sharpness(image, crop_mask),
        fill=float(crop_mask.mean()),
        truncation=truncation(mask, round(border * max(mask.shape))),
        occlusion=1.0 - largest,
        parts=parts,
    )


def truncation(mask: Bool[np.ndarray, "height width"], border: int) -> float:
    """Share of the bounding box's circumference along which the mask reaches the photograph's border or ends just before it.

    Masks are often drawn a few pixels short of the border at which the photograph cuts the animal.

    Args:
        mask: of the photograph.
        border: pixels that are counted as border.
    """
    height, width = mask.shape
    inner = mask[border : height - border, border : width - border]
    return touched_border(inner) if inner.any() else 0.0


def sharpness(image: UInt8[np.ndarray, "side side 3"], mask: Bool[np.ndarray, "side side"]) -> float:
    """Variance of the Laplacian of the grey picture on the animal, without its outline; grey levels squared.

    It is measured in the crop, that is, relative to the animal's size: a small animal enlarged to fill its crop is as useless as a
    large one out of focus.
    """
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float64)
    around = (
        grey[:-2, 1:-1] + grey[2:, 1:-1] + grey[1:-1, :-2] + grey[1:-1, 2:] - 4.0 * grey[1:-1, 1:-1]
    )  # plain sums: the same bits on every machine
    inside = cv2.erode(mask.astype(np.uint8), np.ones((2 * INSIDE + 1, 2 * INSIDE + 1), np.uint8))[1:-1, 1:-1] > 0
    chosen = around[inside if inside.any() else mask[1:-1, 1:-1]]
    return float(chosen.var()) if chosen.size else 0.0


def in_parts(mask: Bool[np.ndarray, "height width"], speck_share: float) -> tuple[float, int]:
    """Share of a mask in its largest connected part (8 neighbours), and how many parts are no specks.

    >>> mask = np.array([[1, 1, 0, 1], [1, 1, 0, 0]], bool)
    >>> in_parts(mask, 0.1)
    (0.8, 2)
    """
    labels, count = connected(mask)
    areas = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    total = int(areas.sum())
    return float(areas.max() / total), int((areas >= speck_share * total).sum())
