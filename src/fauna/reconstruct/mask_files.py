"""Masks that come with a photograph: a file that was named, files beside it, its alpha channel."""

import hashlib
import io
import os
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image

from fauna.data.single import marked_pixels
from fauna.reconstruct.formats import OPENED
from fauna.reconstruct.photograph import Photograph
from fauna.reconstruct.pixels import oriented, read_orientation
from fauna.reconstruct.settings import MaskSettings
from fauna.reconstruct.status import Refused

MaskSource = Literal["given", "beside", "alpha", "segmenter"]
THRESHOLD = 127
SAME_SHAPE = 0.01
"""Relative difference of two aspect ratios up to which a mask is taken for a reduced one of the photograph."""


@dataclass(frozen=True)
class FoundMasks:
    """The masks of a photograph.

    Attributes:
        masks: (height, width) each, of the photograph at working size; not yet split into animals.
        source: where they come from.
        sha256: of their files, or of their pixels.
        flags: of :data:`fauna.reconstruct.status.FLAGS`.
    """

    masks: tuple[Bool[np.ndarray, "height width"], ...]
    source: MaskSource
    sha256: str
    flags: tuple[str, ...] = ()


def masks_beside(photo: Path) -> list[Path]:
    """``x_mask.png`` (also of ``x_rgb.jpg``), else ``masks/x.png``, ``masks/x_1.png``, ``masks/x-2.png`` ..., in the order of their names."""
    stem = photo.stem.removesuffix("_rgb")
    for name in (f"{photo.stem}_mask.png", f"{stem}_mask.png"):
        if os.path.isfile(photo.parent / name):  # no file where the name becomes too long
            return [photo.parent / name]
    folder = photo.parent / "masks"
    if not folder.is_dir():
        return []
    pattern = re.compile(rf"({re.escape(photo.stem)}|{re.escape(stem)})([_-](mask|\d+))?", re.IGNORECASE)
    return sorted(each for each in folder.glob("*.png") if pattern.fullmatch(each.stem))


def read_masks(files: Sequence[Path], photograph: Photograph, source: MaskSource, settings: MaskSettings) -> FoundMasks:
    """The masks in picture files. A picture with a coloured palette (labels) holds one for each colour but black.

    Raises:
        Refused: ``bad_mask``, for a file that is no picture, or none of this photograph.
    """
    masks: list[Bool[np.ndarray, "height width"]] = []
    digest = hashlib.sha256()
    resized = False
    for path in files:
        try:
            content = path.read_bytes()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = _read(content, path, photograph, settings)
        except Refused:
            raise
        except Exception as error:  # a damaged file raises anything
            reason = " ".join(f"{type(error).__name__} {error}".split())[:120]
            raise Refused("bad_mask", f"{path}: expected a readable mask, got {reason}; restore it") from error
        digest.update(content)
        masks += [mask for mask, _ in found]
        resized |= any(changed for _, changed in found)
    return FoundMasks(tuple(masks), source, digest.hexdigest(), ("mask_resized",) if resized else ())


def array_masks(masks: Sequence[np.ndarray], photograph: Photograph) -> FoundMasks:
    """Masks in memory: truth values, zeros and ones, or 8 bits (above 127 is animal), of the photograph's size.

    Raises:
        Refused: ``bad_mask``, for arrays of another kind or size.
    """
    digest = hashlib.sha256()
    found = []
    for mask in masks:
        if mask.ndim != 2 or mask.dtype not in (np.bool_, np.uint8) or mask.shape[::-1] != photograph.size:
            raise Refused(
                "bad_mask",
                f"mask: expected truth values or 8 bits of shape {photograph.size[::-1]}, got {mask.dtype} of shape "
                f"{mask.shape}; make one value for each pixel",
            )
        digest.update(mask.tobytes())
        values = marked_pixels(mask).astype(np.uint8) * np.uint8(255)
        found.append(_fitted(Image.fromarray(values), photograph))
    return FoundMasks(tuple(found), "given", digest.hexdigest())


def alpha_mask(photograph: Photograph, settings: MaskSettings) -> FoundMasks | None:
    """The alpha channel, if it separates a part of the picture from the rest; else ``None``."""
    alpha = photograph.alpha
    if alpha is None:
        return None
    low, high = settings.alpha_shares
    share = float((alpha > THRESHOLD).mean())
    decided = float(((alpha < 32) | (alpha > 223)).mean())
    if not (low <= share <= high and decided >= settings.alpha_decided):
        return None
    return FoundMasks((alpha > THRESHOLD,), "alpha", hashlib.sha256(alpha.tobytes()).hexdigest())


def _read(
    content: bytes, path: Path, photograph: Photograph, settings: MaskSettings
) -> list[tuple[Bool[np.ndarray, "height width"], bool]]:
    with Image.open(io.BytesIO(content), formats=OPENED) as picture:
        orientation = read_orientation(picture)
        resized = _check_shape(picture.size, orientation, path, photograph, settings.max_pixels)
        layers = [
            Image.fromarray(layer.astype(np.uint8) * np.uint8(255)) for layer in _layers(picture, settings.max_animals)
        ]
    if picture.size == _stored(photograph) and orientation == 1 != photograph.orientation:
        orientation = photograph.orientation
    return [(_fitted(oriented(layer, orientation), photograph), resized) for layer in layers]


def _check_shape(size: tuple[int, int], orientation: int, path: Path, photograph: Photograph, most: int) -> bool:
    """Whether the mask has another size than the photograph; refused when it cannot be a mask of it."""
    upright = size if orientation < 5 else size[::-1]
    same = upright == photograph.size or size == _stored(photograph)
    ratio = (upright[0] / upright[1]) / (photograph.size[0] / photograph.size[1])
    if size[0] * size[1] > most or not (same or abs(ratio - 1.0) <= SAME_SHAPE):
        raise Refused(
            "bad_mask",
            f"{path}: expected the photograph's size {photograph.size[0]}x{photograph.size[1]}, got "
            f"{upright[0]}x{upright[1]}; make a mask of this photograph, of at most {most / 1e6:.0f} million pixels",
        )
    return not same


def _layers(picture: Image.Image, limit: int) -> list[Bool[np.ndarray, "height width"]]:
    """The masks in a picture: above 127, or 1 in a picture of zeros and ones; the ``limit`` largest labels of a coloured palette."""
    if picture.mode == "P":
        values = np.array(picture)
        palette = np.zeros((256, 3), np.uint8)
        known = np.array(picture.getpalette("RGB") or [], np.uint8).reshape(-1, 3)[:256]
        palette[: len(known)] = known
        counts = np.bincount(values.ravel(), minlength=256)
        if np.ptp(palette[counts > 0].astype(int), axis=1).any():  # coloured: labels
            counts[~palette.any(axis=1)] = 0
            labels = [each for each in np.argsort(-counts, kind="stable")[:limit] if counts[each]]
            return [values == each for each in labels] or [np.zeros(values.shape, bool)]
    if picture.mode in ("RGBA", "LA") and np.ptp(np.array(picture.convert("L"))) == 0:
        picture = picture.getchannel("A")  # one colour: what separates is its opacity
    grey: UInt8[np.ndarray, "height width"] = np.array(picture.convert("L"))
    return [grey > (THRESHOLD if grey.max(initial=0) > 1 else 0)]


def _stored(photograph: Photograph) -> tuple[int, int]:
    """Size of the photograph before it was turned upright."""
    width, height = photograph.size
    return (width, height) if photograph.orientation < 5 else (height, width)


def _fitted(mask: Image.Image, photograph: Photograph) -> Bool[np.ndarray, "height width"]:
    """The mask at the photograph's working size."""
    height, width = photograph.image.shape[:2]
    if mask.size != (width, height):
        mask = mask.resize((width, height), Image.Resampling.BOX)
    return np.array(mask) > THRESHOLD
