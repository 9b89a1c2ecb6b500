"""One photograph from memory as a batch, cropped by the rule every dataset of the project was cropped by."""

import hashlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image

from fauna.data.cut import cut, mask_window
from fauna.data.photo_loader import PhotoLoader
from fauna.data.photos import Photo, PhotoSource, RawPhoto
from fauna.encoder.base import Encoder
from fauna.errors import FaunaError
from fauna.types import Batch

SIZES = (8, 4096)
"""Of a crop's side, pixels; as ``data.image_size``."""


@dataclass(frozen=True, eq=False)
class ArraySource(PhotoSource):
    """A crop in memory.

    Attributes:
        raw: the crop.
    """

    raw: RawPhoto

    def read(self) -> RawPhoto:
        """The crop."""
        return self.raw

    def content_key(self) -> str:
        """Digest of the pixels."""
        return hashlib.blake2b(self.raw.image.tobytes(), digest_size=16).hexdigest()


def single_photo(encoder: Encoder, image: np.ndarray, mask: np.ndarray, *, crop: bool, size: int) -> Batch:
    """A batch of one photograph.

    Args:
        encoder: that the batch is made for.
        image: (height, width, 3) 8-bit RGB.
        mask: (height, width) of truth values, of 0 and 1, or 8-bit (above 127 is animal).
        crop: cut the crop around the mask; otherwise image and mask are a square crop already.
        size: side of the crop, pixels.

    Raises:
        FaunaError: for arrays of another form, an empty mask, or a crop that is no square.
    """
    _check(image, mask, crop)
    if isinstance(size, bool) or not isinstance(size, int) or not SIZES[0] <= size <= SIZES[1]:
        raise FaunaError(f"size: expected a whole number from {SIZES[0]} to {SIZES[1]}, got {size!r}; e.g. 256")
    marked = marked_pixels(mask)
    if not marked.any():
        raise FaunaError("mask: expected an animal, got an empty mask; mark the animal's pixels")
    if crop:
        raw = RawPhoto(*cut(Image.fromarray(image), marked, mask_window(marked), size), None)
    else:
        raw = RawPhoto(image, marked, None, None)
    return crop_batch(encoder, raw, size=size)


def crop_batch(encoder: Encoder, raw: RawPhoto, *, size: int) -> Batch:
    """A batch of one crop.

    Args:
        encoder: that the batch is made for.
        raw: the crop.
        size: side that image and mask are brought to, pixels.

    Raises:
        FaunaError: when nothing of the animal is left at this size.
    """
    photo = Photo("photo", "unknown", "photo", ArraySource(raw))
    loader = PhotoLoader(encoder=encoder, image_size=size, valid_margin=0.0, cache_features=False, memory_megabytes=0)
    return loader.batch([photo], [False], None)


def marked_pixels(
    mask: Bool[np.ndarray, "height width"] | UInt8[np.ndarray, "height width"],
) -> Bool[np.ndarray, "height width"]:
    """Where the animal is: true, 1 in a mask of zeros and ones, or above 127."""
    return mask if mask.dtype == bool else mask > (127 if mask.max(initial=0) > 1 else 0)


def _check(image: np.ndarray, mask: np.ndarray, crop: bool) -> None:
    for name, given in (("image", image), ("mask", mask)):
        if not isinstance(given, np.ndarray):
            raise FaunaError(f"{name}: expected a numpy array, got {type(given).__name__}; convert it")
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise FaunaError(
            f"image: expected (height, width, 3) 8-bit RGB, got {image.dtype} of shape {image.shape}; convert it"
        )
    if mask.shape != image.shape[:2] or mask.dtype not in (np.bool_, np.uint8):
        raise FaunaError(
            f"mask: expected truth values or 8 bits of shape {image.shape[:2]}, got {mask.dtype} of shape {mask.shape}; "
            "make one value for each pixel"
        )
    if not crop and image.shape[0] != image.shape[1]:
        raise FaunaError(
            f"image: expected a square crop, got {image.shape[1]}x{image.shape[0]}; leave out crop=False to have it cropped"
        )
