"""Rows of a step: photo-major, equally many for every photo (``docs/conventions.md``, section "Words")."""

import torch
from jaxtyping import Shaped
from torch import Tensor


def per_row(values: Shaped[Tensor, "item ..."], rows: int) -> Shaped[Tensor, "row ..."]:
    """Each photo's entry, repeated for its rows; a single entry is shared by all and not copied.

    Raises:
        ValueError: when ``rows`` is not a multiple of the number of entries.
    """
    each = rows_per_item(rows, values.shape[0])
    if values.shape[0] == 1:
        return values.expand(rows, *values.shape[1:])
    return values if each == 1 else torch.repeat_interleave(values, each, dim=0)


def rows_per_item(rows: int, items: int) -> int:
    """Number of rows of each photo.

    Raises:
        ValueError: see :func:`per_row`.
    """
    if items < 1 or rows % items:
        raise ValueError(f"expected equally many rows for each photo, got {rows} rows of {items} photos")
    return rows // items
