"""The two rules by which a square window is laid around a mask."""

import numpy as np
from jaxtyping import Bool

from fauna.data.cut import mask_window


def ruled_window(mask: Bool[np.ndarray, "height width"], rule: str) -> tuple[int, int, int]:
    """Left, top and side of a square window about the centroid of a mask, which is not empty.

    Args:
        mask: of the animal.
        rule: ``widen`` is the rule of the project's datasets: side ``2 sqrt(area)``, widened where that would cut the animal;
            ``fauna`` never widens (3D-Fauna, data preparation).

    Returns:
        Whole pixels; the window may exceed the photograph.
    """
    if rule == "widen":
        return mask_window(mask)
    rows, columns = np.nonzero(mask)
    side = int(np.ceil(2.0 * np.sqrt(len(rows))))
    x, y = float(columns.mean()) + 0.5, float(rows.mean()) + 0.5
    return int(np.floor(x - 0.5 * side)), int(np.floor(y - 0.5 * side)), side
