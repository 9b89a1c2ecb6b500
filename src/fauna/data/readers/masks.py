"""Masks as annotation files store them: image files, run lengths (COCO) and polygons (COCO)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int
from PIL import Image
from skimage.draw import polygon

from fauna.data.photos import MASK_THRESHOLD
from fauna.errors import FaunaError


@dataclass(frozen=True)
class MaskFile:
    """A mask stored as a picture of the photograph's size; first channel counts.

    Foreground is what lies above 127, or is 1 in a picture of zeros and ones.

    Attributes:
        path: of the picture.
    """

    path: Path

    def decode(self, height: int, width: int) -> Bool[np.ndarray, "{height} {width}"]:
        """The mask; raises FaunaError for a missing or broken file or another size."""
        try:
            with Image.open(self.path) as picture:
                values = np.array(picture.convert("L") if picture.mode in ("P", "1") else picture)
        except (OSError, SyntaxError, ValueError) as error:
            raise FaunaError(f"{self.path} expects a readable mask, got {_line(error)}; restore it") from error
        values = values if values.ndim == 2 else values[..., 0]
        _check_size(str(self.path), values.shape, (height, width))
        return values.astype(np.int64) > (MASK_THRESHOLD if values.max(initial=0) > 1 else 0)


@dataclass(frozen=True)
class Rle:
    """Run lengths in column-major order, background first, as in COCO.

    Attributes:
        height: of the photograph, pixels.
        width: of the photograph, pixels.
        counts: run lengths, or COCO's compressed string of them.
    """

    height: int
    width: int
    counts: tuple[int, ...] | str

    def decode(self, height: int, width: int) -> Bool[np.ndarray, "{height} {width}"]:
        """The mask; raises FaunaError when runs do not fill the photograph or sizes differ."""
        _check_size("a run-length mask", (self.height, self.width), (height, width))
        counts = decode_counts(self.counts) if isinstance(self.counts, str) else np.array(self.counts, np.int64)
        if counts.size == 0 or counts.min() < 0 or counts.sum() != self.height * self.width:
            raise FaunaError(
                f"a run-length mask expects runs that fill {self.width}x{self.height} pixels, got {counts.sum()}; "
                "mend or remove the segmentation"
            )
        values = np.arange(counts.size) % 2 == 1
        return np.repeat(values, counts).reshape(self.width, self.height).T.copy()


@dataclass(frozen=True)
class Polygons:
    """Outlines whose union is the mask.

    Attributes:
        rings: one flat tuple (x0, y0, x1, y1, ...) per outline, photograph pixels, 0 is the left or top edge.
    """

    rings: tuple[tuple[float, ...], ...]

    def decode(self, height: int, width: int) -> Bool[np.ndarray, "{height} {width}"]:
        """Pixels whose centre lies inside an outline."""
        mask = np.zeros((height, width), bool)
        for ring in self.rings:
            points = np.array(ring).reshape(-1, 2) - 0.5  # pixel centres are whole numbers for scikit-image
            mask[polygon(points[:, 1], points[:, 0], (height, width))] = True
        return mask


Mask = MaskFile | Rle | Polygons


def decode_counts(text: str) -> Int[np.ndarray, " run"]:
    """Run lengths of COCO's compressed string.

    Every character carries five bits of a number, lowest first, plus 48; bit 5 says that more follow and bit 4 of the last is
    the sign. From the fourth on, numbers are differences to the run two places before.

    Args:
        text: the string, e.g. ``segmentation["counts"]``.

    Returns:
        Run lengths, background first.

    Raises:
        FaunaError: for characters outside the code and for a number that does not end.

    >>> decode_counts("52203").tolist()
    [5, 2, 2, 2, 5]
    """
    runs: list[int] = []
    value = shift = 0
    for character in text:
        bits = ord(character) - 48
        if not 0 <= bits < 64:
            raise FaunaError(f"a compressed mask expects characters from '0' to 'o', got {character!r}; mend the file")
        value |= (bits & 31) << shift
        shift += 5
        if bits & 32:
            continue
        if bits & 16:
            value -= 1 << shift
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
        value = shift = 0
    if shift:
        raise FaunaError("a compressed mask expects a complete last number, got one that breaks off; mend the file")
    return np.array(runs, np.int64)


def encode_mask(mask: Bool[np.ndarray, "height width"]) -> Rle:
    """A mask as uncompressed run lengths: small and hashable.

    >>> encode_mask(np.array([[False, True], [True, True]])).counts
    (1, 3)
    """
    flat = mask.T.reshape(-1)
    changes = np.flatnonzero(flat[1:] != flat[:-1]) + 1
    counts = np.diff(np.concatenate([[0], changes, [flat.size]]))
    first = [0] if flat[0] else []
    return Rle(mask.shape[0], mask.shape[1], tuple([*first, *counts.tolist()]))


def parse_segmentation(segmentation: object, height: int, width: int) -> Mask | None:
    """The ``segmentation`` of a COCO annotation: polygons, run lengths or a compressed string.

    Args:
        segmentation: a list of outlines, ``{"size": [height, width], "counts": list or string}``, or nothing.
        height: of the photograph, for run lengths without a size.
        width: likewise.

    Returns:
        The mask, ``None`` where the annotation has none.

    Raises:
        FaunaError: for anything else.
    """
    if not segmentation:
        return None
    try:
        if isinstance(segmentation, str):
            return Rle(height, width, segmentation)
        if isinstance(segmentation, dict):
            rows, columns = segmentation.get("size", (height, width))
            counts = segmentation["counts"]
            return Rle(int(rows), int(columns), counts if isinstance(counts, str) else tuple(int(c) for c in counts))
        rings = tuple(tuple(float(v) for v in ring) for ring in segmentation)  # type: ignore[attr-defined]
    except (TypeError, ValueError, KeyError) as error:
        raise FaunaError(f"segmentation expects polygons or run lengths, got {_line(error)}; mend the file") from error
    rings = tuple(ring for ring in rings if len(ring) >= 6 and len(ring) % 2 == 0)
    return Polygons(rings) if rings else None


def _check_size(what: str, got: Sequence[int], expected: tuple[int, int]) -> None:
    if tuple(got[:2]) != expected:
        raise FaunaError(
            f"{what} expects the photograph's size {expected[1]}x{expected[0]}, got {got[1]}x{got[0]}; restore the originals"
        )


def _line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__} {error}".split())
