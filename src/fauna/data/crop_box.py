"""Where a crop lies in its original photo, and which of its pixels the photo really shows."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fauna.data.stored import StoredFile
from fauna.errors import FaunaError

MIN_FIELDS = 7  # frame x0 y0 w h photo_w photo_h; an eighth, sharpness, is not used


@dataclass(frozen=True)
class CropBox:
    """A crop window in pixels of the original photo; the window may reach beyond the photo.

    Attributes:
        x0: left edge.
        y0: top edge.
        width: of the window, positive.
        height: of the window, positive.
        photo_width: of the photo.
        photo_height: of the photo.
    """

    x0: float | int
    y0: float | int
    width: float | int
    height: float | int
    photo_width: float | int
    photo_height: float | int


def read_box(path: StoredFile) -> CropBox:
    """Read a ``box.txt``: one line ``frame x0 y0 w h photo_w photo_h [sharpness]``, separated by white space.

    Raises:
        FaunaError: if the line does not hold these numbers.
    """
    fields = path.read_text(encoding="utf-8", errors="replace").split()
    try:
        numbers = [float(field) for field in fields[1:MIN_FIELDS]]
    except ValueError:
        numbers = []
    bad_side = len(numbers) == MIN_FIELDS - 1 and min(numbers[2:]) <= 0
    if len(numbers) < MIN_FIELDS - 1 or bad_side or not all(map(math.isfinite, numbers)):
        raise FaunaError(
            f"{path} expects `frame x0 y0 w h photo_w photo_h` with positive sizes, got {' '.join(fields)[:80]!r}; mend or remove it"
        )
    return CropBox(*numbers)


def valid_mask(box: CropBox | None, *, size: int, margin: float) -> Float[Tensor, "size size"]:
    """Pixels whose source lies inside the photo and not within ``margin`` of its border (3D-Fauna's valid region).

    Args:
        box: the crop window; ``None`` means nothing is known and every pixel counts as valid.
        size: side of the mask, pixels.
        margin: width of the strip along the photo's border that is not trusted, in crop widths.

    Returns:
        (size, size) of 0 and 1. A crop farther than ``margin`` from every border of the photo is all ones.
    """
    if box is None:
        return torch.ones(size, size)
    columns = _inside(box.x0, box.width, box.photo_width, size, margin)
    rows = _inside(box.y0, box.height, box.photo_height, size, margin)
    return rows[:, None] * columns[None, :]


def _inside(
    start: float | int, extent: float | int, limit: float | int, size: int, margin: float
) -> Float[Tensor, " size"]:
    """1 for the pixel centres along one axis that fall into [margin, limit - margin]."""
    centres = start + (torch.arange(size, dtype=torch.float64) + 0.5) / size * extent
    strip = margin * extent
    return ((centres >= strip) & (centres <= limit - strip)).float()
