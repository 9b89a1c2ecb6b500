"""Masks of the work folder: 1-bit PNG at working size."""

import io
from pathlib import Path

import numpy as np
from jaxtyping import Bool
from PIL import Image

Mask = Bool[np.ndarray, "height width"]


def encode_mask(mask: Mask) -> bytes:
    """A mask as a 1-bit PNG."""
    buffer = io.BytesIO()
    Image.fromarray(mask).save(buffer, "PNG")
    return buffer.getvalue()


def read_mask(path: Path) -> Mask:
    """A mask that :func:`encode_mask` wrote."""
    with Image.open(path) as picture:
        return np.array(picture.convert("1"))
