"""Reading the files of a crop."""

import hashlib
import json
import os

import numpy as np
from jaxtyping import Float
from PIL import Image

from fauna.data.stored import Member, StoredFile, readable
from fauna.errors import FaunaError


def digest_file(path: StoredFile) -> str:
    """Digest of a file's bytes, hexadecimal.

    Raises:
        FaunaError: when it cannot be read.
    """
    try:
        return hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()
    except OSError as error:
        raise FaunaError(f"{path} expects a readable image, got {error.strerror}; restore it") from error


def file_stamp(path: StoredFile | None) -> str:
    """Path, size and time of last change, without reading the file."""
    if path is None:
        return "none"
    try:
        found = os.stat(path.shard if isinstance(path, Member) else path)
    except OSError:
        return f"{path}:absent"
    place = f"@{path.offset}" if isinstance(path, Member) else ""
    return f"{path}{place}:{found.st_size}:{found.st_mtime_ns}"


def decode_image(path: StoredFile, mode: str | None) -> np.ndarray:
    """Pixels of an image file as an array, converted to ``mode`` if given.

    Raises:
        FaunaError: when it is missing or broken.
    """
    try:
        with Image.open(readable(path)) as picture:
            if mode is None and picture.mode in ("P", "1"):
                mode = "L"
            return np.array(picture.convert(mode) if mode else picture)
    except FileNotFoundError as error:
        raise FaunaError(f"{path} expects an image file, got nothing there; add it or leave the photo out") from error
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        reason = " ".join(str(error).split())
        raise FaunaError(f"{path} expects a readable image, got a broken one ({reason}); replace it") from error


def read_keypoints(path: StoredFile) -> Float[np.ndarray, "key 3"]:
    """x, y in crop pixels and 1 where annotated.

    Raises:
        FaunaError: when the file is broken.
    """
    try:
        points = np.array(json.loads(path.read_text(encoding="utf-8"))["keypoints"], dtype=np.float64)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FaunaError(
            f'{path} expects {{"keypoints": [[x, y, annotated], ...]}}, got {error}; mend or remove it'
        ) from error
    if points.ndim != 2 or points.shape[1] != 3:
        raise FaunaError(f"{path} expects (key, 3) keypoints, got shape {points.shape}; mend or remove it")
    return points
