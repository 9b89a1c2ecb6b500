"""Drawn pictures kept on disk: image and mask as one RGBA file, crop window and keypoints in its notes."""

import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from fauna.data.crop_box import CropBox
from fauna.data.feature_cache import write_atomically
from fauna.data.photos import RawPhoto

Drawing = tuple[
    UInt8[np.ndarray, "size size 3"], UInt8[np.ndarray, "size size"], tuple[int, ...], Float[np.ndarray, "key 3"]
]
"""Image, mask (0 or 255), crop window as :class:`CropBox` lists it, and keypoints as :class:`RawPhoto` has them."""


def read_or_draw(path: Path, draw: Callable[[], Drawing]) -> RawPhoto:
    """The picture at ``path``; if there is none, or a damaged one, it is drawn and kept.

    Args:
        path: PNG file, made if missing.
        draw: makes the picture.
    """
    if path.is_file():
        try:
            with Image.open(path) as picture:
                rgba = np.array(picture)
                box = CropBox(*(float(picture.info[name]) for name in CropBox.__dataclass_fields__))
                keypoints = np.array(json.loads(picture.info["keypoints"]), dtype=np.float64)
            return RawPhoto(np.ascontiguousarray(rgba[..., :3]), rgba[..., 3] > 127, box, keypoints)
        except (OSError, KeyError, ValueError, SyntaxError):
            path.unlink(missing_ok=True)  # damaged: drawn again
    image, mask, window, keypoints = draw()
    box = CropBox(*(float(number) for number in window))
    notes = PngInfo()
    for name in CropBox.__dataclass_fields__:
        notes.add_text(name, str(getattr(box, name)))
    notes.add_text("keypoints", json.dumps(keypoints.tolist()))
    buffer = io.BytesIO()
    Image.fromarray(np.dstack([image, mask])).save(buffer, format="PNG", pnginfo=notes, compress_level=1)
    write_atomically(path, buffer.getvalue())
    return RawPhoto(image, mask > 127, box, keypoints)
