"""One annotated animal in a photograph, and the square crop that is cut around it."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from PIL import Image

from fauna.data.crop_window import crop_window
from fauna.data.cut import cut, mask_window
from fauna.data.photo_files import digest_file
from fauna.data.photos import MaskSource, PhotoSource, RawPhoto
from fauna.data.readers.masks import Mask, MaskFile
from fauna.errors import FaunaError

Box = tuple[float, float, float, float]
"""Left, top, right, bottom in pixels of the photograph; 0 is the left or top edge."""


@dataclass(frozen=True)
class CropSource(PhotoSource):
    """An animal of a photograph, cropped when read.

    Attributes:
        image: the whole photograph.
        origin: file and entry of the annotation, for messages.
        size: (width, height) of the photograph as annotated, ``None`` when the annotation does not say.
        box: of the animal; needed where there is no mask.
        mask: of the animal, ``None`` where only a box is known.
        keypoints: (x, y, 1 where annotated) in pixels of the photograph, 0 is the left or top edge; ``None`` without.
        crop_size: side of the crop, pixels.
        box_fill: share of its box that an animal without mask is taken to cover.
    """

    image: Path
    origin: str
    size: tuple[int, int] | None
    box: Box | None
    mask: Mask | None
    keypoints: tuple[tuple[float, float, float], ...] | None
    crop_size: int
    box_fill: float

    @property
    def mask_source(self) -> MaskSource:
        """``box`` where the mask is only the box."""
        return "box" if self.mask is None else "annotation"

    def read(self) -> RawPhoto:
        """Decode the photograph and cut the crop.

        Raises:
            FaunaError: for a broken photograph, one of another size than annotated, or an empty mask.
        """
        photograph = self._decode()
        width, height = photograph.size
        if self.size is not None and self.size != (width, height):
            raise FaunaError(
                f"{self.image} expects the annotated size {self.size[0]}x{self.size[1]}, got {width}x{height}; "
                "restore the original photograph"
            )
        mask = self._mask(height, width)
        left, top, side = self._window(mask)
        image, small, box = cut(photograph, mask, (left, top, side), self.crop_size)
        if not small.any():
            raise FaunaError(
                f"{self.origin} expects a visible animal, got none left at {self.crop_size} px; leave it out"
            )
        return RawPhoto(image, small, box, self._keypoints(left, top, side), self.mask_source)

    def content_key(self) -> str:
        """Digest of the photograph's file and of all that decides which part of it is the crop."""
        digest = hashlib.blake2b(digest_size=16)
        files = [self.image, *([self.mask.path] if isinstance(self.mask, MaskFile) else [])]
        try:
            for file in files:
                digest.update(file.read_bytes())
        except OSError as error:
            raise FaunaError(f"{error.filename} expects a readable image, got {error.strerror}; restore it") from error
        digest.update(repr((self.box, self.mask, self.crop_size, self.box_fill)).encode())
        return digest.hexdigest()

    def annotation_key(self) -> str:
        """Digest of the keypoints."""
        return hashlib.blake2b(repr(self.keypoints).encode(), digest_size=16).hexdigest()

    def pictured(self) -> str:
        """Digest of the photograph's file, whichever animal and part of it the crop shows."""
        return digest_file(self.image)

    def _decode(self) -> Image.Image:
        try:
            with Image.open(self.image) as picture:
                return picture.convert("RGB")
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            reason = " ".join(str(error).split())
            raise FaunaError(f"{self.image} expects a readable photograph, got {reason}; restore it") from error

    def _mask(self, height: int, width: int) -> Bool[np.ndarray, "{height} {width}"]:
        if self.mask is not None:
            mask = self.mask.decode(height, width)
        else:
            mask = np.zeros((height, width), bool)
            left, top, right, bottom = self._clipped(height, width)
            mask[int(top) : int(np.ceil(bottom)), int(left) : int(np.ceil(right))] = True
        if not mask.any():
            raise FaunaError(f"{self.origin} expects an animal inside the photograph, got an empty mask; leave it out")
        return mask

    def _window(self, mask: Bool[np.ndarray, "height width"]) -> tuple[int, int, int]:
        """The shared crop rule on the mask, or on a box of which ``box_fill`` is taken to be animal."""
        if self.mask is None:
            left, top, right, bottom = bounds = self._clipped(*mask.shape)
            area = self.box_fill * (right - left) * (bottom - top)
            return crop_window(area, (0.5 * (left + right), 0.5 * (top + bottom)), bounds)
        return mask_window(mask)

    def _clipped(self, height: int, width: int) -> Box:
        if self.box is None:
            raise FaunaError(f"{self.origin} expects a mask or a box, got neither; leave it out")
        clipped = clip_box(self.box, height=height, width=width)
        if clipped is None:
            raise FaunaError(f"{self.origin} expects a box inside the photograph, got {self.box}; leave it out")
        return clipped

    def _keypoints(self, left: int, top: int, side: int) -> Float[np.ndarray, "key 3"] | None:
        if self.keypoints is None:
            return None
        points = np.array(self.keypoints, np.float64).reshape(-1, 3)
        points[:, :2] = (points[:, :2] - [left, top]) * (self.crop_size / side)
        points[points[:, 2] == 0] = 0.0
        return points


def clip_box(box: Box, *, height: int, width: int) -> Box | None:
    """The part of a box inside the photograph, ``None`` when there is none.

    >>> clip_box((-5.0, 10.0, 20.0, 300.0), height=200, width=100)
    (0.0, 10.0, 20.0, 200.0)
    """
    left, top, right, bottom = max(box[0], 0.0), max(box[1], 0.0), min(box[2], float(width)), min(box[3], float(height))
    return (left, top, right, bottom) if right > left and bottom > top else None


def widen_box(box: Box, margin: float) -> Box:
    """The box with ``margin`` times its larger side added on each side.

    >>> widen_box((10.0, 10.0, 30.0, 20.0), 0.5)
    (0.0, 0.0, 40.0, 30.0)
    """
    left, top, right, bottom = box
    extra = margin * max(right - left, bottom - top)
    return left - extra, top - extra, right + extra, bottom + extra
