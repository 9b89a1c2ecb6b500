"""Opening annotation files and finding the photographs they name."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fauna.errors import FaunaError


def read_json(path: Path) -> Any:
    """Content of a JSON file; raises FaunaError when it is missing or broken."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise FaunaError(
            f"{path} expects an annotation file, got nothing there; check data.root and data.source.annotations"
        ) from error
    except (OSError, ValueError) as error:
        raise FaunaError(
            f"{path} expects a JSON file, got {' '.join(str(error).split())}; download it again"
        ) from error


def require(entry: object, keys: Sequence[str], where: str) -> Mapping[str, Any]:
    """``entry`` as a mapping with these keys; raises FaunaError that names the missing ones."""
    if not isinstance(entry, Mapping):
        raise FaunaError(f"{where} expects an object with {', '.join(keys)}, got {type(entry).__name__}; mend the file")
    missing = [key for key in keys if key not in entry]
    if missing:
        raise FaunaError(
            f"{where} expects the keys {', '.join(keys)}, got no {', '.join(missing)}; choose the reader of this format"
        )
    return entry


def entries(value: object, where: str) -> Sequence[Any]:
    """``value`` as a list; raises FaunaError for anything else."""
    if not isinstance(value, list):
        raise FaunaError(f"{where} expects a list, got {type(value).__name__}; choose the reader of this format")
    return value


def forward_slashes(name: str) -> str:
    r"""A file name as annotated, perhaps on another system, with forward slashes.

    >>> forward_slashes("D:\\set\\3cat\\v10c1\\frame1.jpg")
    'D:/set/3cat/v10c1/frame1.jpg'
    """
    return name.replace("\\", "/")


def find_image(folder: Path, name: str) -> Path | None:
    """The photograph ``name`` below ``folder``; leading folders that exist only on the annotators' disk are dropped one by one.

    Args:
        folder: of photographs.
        name: with forward slashes.

    Returns:
        The first file found, ``None`` without one.
    """
    parts = [part for part in name.split("/") if part not in ("", ".", "..")]
    for start in range(len(parts)):
        path = folder.joinpath(*parts[start:])
        if os.path.isfile(path):  # not so for names that no file can have
            return path
    return None


def keypoint_rows(
    values: object, where: str, *, shift: float, min_visibility: float
) -> tuple[tuple[float, float, float], ...]:
    """Keypoints as (x, y, 1 where annotated) in pixels of the photograph, 0 is the left or top edge.

    Args:
        values: (key, 3) or flat list of x, y, flag.
        where: named in messages.
        shift: added to x and y: 0.5 where whole numbers are pixel centres counted from 0, -0.5 where they are counted from 1.
        min_visibility: smallest flag that counts as annotated.

    Raises:
        FaunaError: when the numbers do not come in threes.
    """
    try:
        points = np.array(values, np.float64)
    except (TypeError, ValueError) as error:
        raise FaunaError(f"{where} expects keypoints as x, y, flag, got {error}; mend the file") from error
    if points.size % 3 or (points.ndim == 2 and points.shape[1] != 3) or points.ndim > 2:
        raise FaunaError(f"{where} expects keypoints as x, y, flag, got shape {points.shape}; mend the file")
    points = points.reshape(-1, 3)
    known = np.isfinite(points).all(1) & (points[:, 2] >= min_visibility)
    rows = np.where(known[:, None], points + [shift, shift, 0.0], 0.0)
    rows[:, 2] = known
    return tuple((float(x), float(y), float(flag)) for x, y, flag in rows)


def box_of(values: object, where: str) -> tuple[float, float, float, float]:
    """Four finite numbers; raises FaunaError for anything else."""
    try:
        numbers = np.array(values, np.float64)
    except (TypeError, ValueError) as error:
        raise FaunaError(f"{where} expects a box of four numbers, got {error}; mend the file") from error
    if numbers.shape != (4,) or not np.isfinite(numbers).all():
        raise FaunaError(f"{where} expects a box of four numbers, got {str(values)[:60]}; mend the file")
    first, second, third, fourth = (float(number) for number in numbers)
    return first, second, third, fourth
