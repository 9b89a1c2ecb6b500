"""Reading a photograph of any kind, with bounded memory, into 8-bit RGB as a person sees it."""

import hashlib
import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from fauna.errors import FaunaError
from fauna.reconstruct.formats import OPENED, SUFFIXES
from fauna.reconstruct.pixels import oriented, read_orientation, to_rgb
from fauna.reconstruct.settings import PhotoSettings
from fauna.reconstruct.status import Refused

Source = Path | Image.Image | np.ndarray


@dataclass(frozen=True)
class Photograph:
    """A photograph, upright, at working size.

    Attributes:
        image: (height, width, 3) 8-bit RGB.
        alpha: opacity, where there is an alpha channel.
        name: of the file, or ``photo``.
        path: of the file, ``None`` for a photograph from memory.
        sha256: of the file's bytes, or of the pixels.
        format: of the file, e.g. ``JPEG``; ``array`` from memory.
        size: (width, height) upright, before any reduction.
        orientation: EXIF tag by which it was turned, 1 for none.
        flags: of :data:`fauna.reconstruct.status.FLAGS`.
    """

    image: UInt8[np.ndarray, "height width 3"]
    alpha: UInt8[np.ndarray, "height width"] | None
    name: str
    path: Path | None
    sha256: str
    format: str
    size: tuple[int, int]
    orientation: int
    flags: tuple[str, ...]

    @property
    def scale(self) -> float:
        """Pixels of the photograph per pixel of :attr:`image`."""
        return self.size[0] / self.image.shape[1]


def read_photograph(source: Source, settings: PhotoSettings) -> Photograph:
    """Read a photograph.

    Args:
        source: a file; or a PIL picture; or an array of (height, width, 3 or 4) or (height, width), 8 bits.
        settings: limits.

    Raises:
        Refused: with a status, when it cannot be used.
    """
    if isinstance(source, Path):
        content = _content(source, settings)
        with _refusing(source.name), Image.open(io.BytesIO(content), formats=OPENED) as picture:
            _check_size(picture.size, _most_pixels(picture, settings), source.name, settings)
            found = _finish(picture, picture.format or "", settings)
        flags = found.flags
        if source.suffix.lower() not in SUFFIXES[found.format]:
            flags = ("wrong_suffix", *flags)
        return replace(found, name=source.stem, path=source, sha256=hashlib.sha256(content).hexdigest(), flags=flags)
    with _refusing("photo"):
        picture = source if isinstance(source, Image.Image) else _from_array(source)
        _check_size(picture.size, settings.max_pixels, "photo", settings)
        found = _finish(picture.copy(), "array", settings)
    return replace(found, sha256=hashlib.sha256(found.image.tobytes()).hexdigest())


def _content(path: Path, settings: PhotoSettings) -> bytes:
    try:
        if not path.is_file():
            raise Refused("unreadable", f"{path}: expected a photograph, got no file; check the path")
        size = path.stat().st_size
        if size == 0:
            raise Refused("unreadable", f"{path}: expected a photograph, got an empty file; restore it")
        if size > settings.max_bytes:
            raise Refused(
                "too_large", f"{path}: expected at most {settings.max_bytes:,} bytes, got {size:,}; make it smaller"
            )
        return path.read_bytes()
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise Refused("unreadable", f"{path}: expected a readable file, got {reason}; check its permissions") from error


@contextmanager
def _refusing(name: str) -> Iterator[None]:
    """Turn whatever a damaged picture makes Pillow raise into a refusal."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged notes inside the file, and of sizes that are checked here
            yield
    except FaunaError:
        raise
    except Image.DecompressionBombError as error:
        raise Refused(
            "too_large", f"{name}: expected a photograph, got too many pixels ({_line(error)}); reduce it"
        ) from error
    except Image.UnidentifiedImageError as error:
        known = ", ".join(OPENED)
        raise Refused(
            "unreadable", f"{name}: expected one of {known}, got a file of another kind; convert it"
        ) from error
    except MemoryError as error:
        raise Refused(
            "too_large", f"{name}: expected a photograph that fits into memory, got a larger one; reduce it"
        ) from error
    except Exception as error:  # anything from SyntaxError to IndexError
        raise Refused(
            "unreadable", f"{name}: expected a readable picture, got a damaged one ({_line(error)}); restore it"
        ) from error


def _most_pixels(picture: Image.Image, settings: PhotoSettings) -> int:
    """JPEG can be decoded at a reduced size; when progressive, its coefficients are held whole all the same."""
    if picture.format not in ("JPEG", "MPO"):
        return settings.max_pixels
    progressive = picture.info.get("progressive") or picture.info.get("progression")
    return settings.max_pixels_progressive if progressive else settings.max_pixels_jpeg


def _check_size(size: tuple[int, int], most: int, name: str, settings: PhotoSettings) -> None:
    width, height = size
    if width * height > most:
        raise Refused(
            "too_large", f"{name}: expected at most {most / 1e6:.0f} million pixels, got {width}x{height}; reduce it"
        )
    if min(width, height) < settings.min_side:
        raise Refused(
            "too_small",
            f"{name}: expected at least {settings.min_side} pixels a side, got {width}x{height}; use a larger one",
        )


def _finish(picture: Image.Image, kind: str, settings: PhotoSettings) -> Photograph:
    flags = []
    stored = picture.size
    orientation = read_orientation(picture)
    if kind != "MPO" and getattr(picture, "is_animated", False):
        flags.append("animated")
    if kind in ("JPEG", "MPO"):
        picture.draft(None, (settings.work_side, settings.work_side))
    picture.load()
    shrink = max(picture.size) / settings.work_side
    rgb, alpha, profile_used = to_rgb(picture, shrink)
    if not profile_used:
        flags.append("colour_profile_ignored")
    if orientation != 1:
        flags.append("rotated")
    rgb, alpha = oriented(rgb, orientation), None if alpha is None else oriented(alpha, orientation)
    if rgb.size[0] * rgb.size[1] < stored[0] * stored[1]:
        flags.append("reduced")
    size = stored if orientation < 5 else (stored[1], stored[0])
    return Photograph(
        image=np.array(rgb),
        alpha=None if alpha is None else np.array(alpha),
        name="photo",
        path=None,
        sha256="",
        format=kind,
        size=size,
        orientation=orientation,
        flags=tuple(flags),
    )


def _from_array(array: np.ndarray) -> Image.Image:
    if (
        array.dtype != np.uint8
        or not (array.ndim == 2 or (array.ndim == 3 and array.shape[2] in (3, 4)))
        or not array.size
    ):
        raise Refused(
            "unreadable",
            f"photo: expected (height, width, 3) 8-bit RGB, got {array.dtype} of shape {array.shape}; convert it",
        )
    return Image.fromarray(array)


def _line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__} {error}".split())[:160]
