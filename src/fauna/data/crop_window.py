"""The rule by which a square crop is cut around an animal: shared by the zoo, the readers and preparation."""

import numpy as np


def crop_window(
    area: float, centroid: tuple[float, float], bounds: tuple[float, float, float, float]
) -> tuple[int, int, int]:
    """Square window of side ``2 sqrt(area)`` about the centroid; where it would cut the animal, the smallest that does not, x 1.04.

    Args:
        area: of the mask, pixels.
        centroid: (x, y) mean pixel coordinates of the mask.
        bounds: (left, top, right, bottom) of the mask.

    Returns:
        Left, top and side in whole pixels; the window may exceed the photo.
    """
    side = 2.0 * np.sqrt(area)
    (x, y), (left, top, right, bottom) = centroid, bounds
    needed = 2.0 * max(x - left, right - x, y - top, bottom - y)
    if needed > side:
        side = 1.04 * needed
    whole = int(np.ceil(side))
    return int(np.floor(x - 0.5 * whole)), int(np.floor(y - 0.5 * whole)), whole
