"""Walking a tree of photographs with bounded memory, in an order that is the same on every machine."""

import os
from collections.abc import Iterator
from pathlib import Path

from fauna.reconstruct.formats import PHOTO_SUFFIXES

MASK_FOLDERS = frozenset({"masks", "mask", "annotations", "figure_ground", "segmentations"})
"""Folders of pictures that are masks."""


def is_picture(path: Path) -> bool:
    """Whether a file's name is that of a picture, and not that of a hidden file."""
    return path.suffix.lower() in PHOTO_SUFFIXES and not path.name.startswith(".")


def is_photo(path: Path) -> bool:
    """The same, but neither a mask nor another file of a crop."""
    return is_picture(path) and not path.stem.lower().endswith(("_mask", "_feat16", "_flow", "_clusters"))


def walk(
    folder: Path, *, skip: frozenset[str] = MASK_FOLDERS, avoid: frozenset[Path] = frozenset()
) -> Iterator[Path | OSError]:
    """Files below a folder, sorted by the bytes of their names, folder by folder; links to folders are not followed.

    Args:
        folder: where to begin.
        skip: names of folders, in lower case, that are left out; hidden ones are too.
        avoid: folders that are left out: where results go, should they lie within.

    Yields:
        Files; the error instead where a folder cannot be listed.
    """
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: os.fsencode(entry.name))
    except OSError as error:
        yield error
        return
    for entry in entries:
        try:
            is_file = entry.is_file()
        except OSError as error:  # a link to itself
            yield error
            continue
        if is_file:
            yield Path(entry.path)
    for entry in entries:
        name = entry.name
        if entry.is_dir(follow_symlinks=False) and not name.startswith(".") and name.lower() not in skip:
            path = Path(entry.path)
            if path not in avoid:
                yield from walk(path, skip=skip, avoid=avoid)


def subfolders(folder: Path) -> list[Path]:
    """Folders in a folder, sorted as :func:`walk` does, without hidden ones; none where it cannot be listed."""
    try:
        found = [Path(entry.path) for entry in os.scandir(folder) if entry.is_dir() and entry.name[0] != "."]
    except OSError:
        return []
    return sorted(found, key=lambda path: os.fsencode(path.name))
