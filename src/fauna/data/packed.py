"""Packed sets: many crops in few tar files, read where they lie. ``fauna-prepare pack`` writes them, ``data=fauna`` reads them like folders.

``root/packed.json`` names the shards; ``00000.tar`` holds ``<species>/<split>/<stem>.rgb.jpg`` and the other files of each crop side by side
(what is called a WebDataset); ``00000.parquet`` says where in the tar each file lies, so that crops are read in any order without
unpacking; ``root/keypoint_names.json`` is as in a folder.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fauna.data.fauna_folder import CategoryPhotos
from fauna.data.photos import FileSource, Photo
from fauna.data.stored import Member
from fauna.errors import FaunaError

FILE = "packed.json"
VERSION = 1
LISTS = ("train", "val", "test", "back_views")
"""Of :class:`~fauna.data.fauna_folder.CategoryPhotos`."""
KINDS = ("rgb", "mask", "box", "keypoints", "feat16")
"""Files of a crop; the index has ``<kind>_name``, ``<kind>_offset`` and ``<kind>_size`` of each."""
TEXTS = ("category", "list", "name", "photograph")


def is_packed(root: Path) -> bool:
    """Whether a folder is a packed set."""
    return (root / FILE).is_file()


def read_packed(root: Path) -> dict[str, CategoryPhotos]:
    """List all photos of a packed set without opening a shard; the same as of the folder that was packed.

    Args:
        root: folder of the shards.

    Returns:
        Categories in alphabetical order.

    Raises:
        FaunaError: when an index is missing or damaged, or a shard has another size than was packed.
    """
    found: dict[str, dict[str, list[Photo]]] = {}
    for entry in read_shards(root):
        shard = root / str(entry["file"])
        size = shard.stat().st_size if shard.is_file() else -1
        if size != entry["bytes"]:
            raise FaunaError(f"{shard} expects {entry['bytes']} bytes, got {max(size, 0)}; copy the shard again")
        for category, which, photo in read_index(shard):
            found.setdefault(category, {name: [] for name in LISTS})[which].append(photo)
    if not found:
        raise FaunaError(f"{root / FILE} expects photos, got none; pack the set again")
    return {
        category: CategoryPhotos(category, **{name: tuple(photos) for name, photos in lists.items()})
        for category, lists in sorted(found.items())
    }


def read_shards(root: Path) -> list[dict[str, Any]]:
    """What ``packed.json`` says of each shard: ``file``, ``bytes``, ``photos``, ``sha256``.

    Raises:
        FaunaError: when it is missing, damaged, or of another version.
    """
    path = root / FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        version, listed = content["version"], content["shards"]
        shards = [{key: each[key] for key in ("file", "bytes", "photos", "sha256")} for each in listed]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FaunaError(
            f"{path} expects the list of shards, got {' '.join(str(error).split())}; pack the set again"
        ) from error
    if version != VERSION:
        raise FaunaError(f"{path} expects version {VERSION}, got {version}; pack the set again")
    return shards


def read_index(shard: Path) -> Iterator[tuple[str, str, Photo]]:
    """Category, list of :data:`LISTS` and files of every photo of a shard.

    Raises:
        FaunaError: when its index is missing or damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    index = shard.with_suffix(".parquet")
    try:
        with pq.ParquetFile(index) as file:
            for batch in file.iter_batches():
                for values in batch.to_pylist():
                    yield values["category"], values["list"], _photo(shard, values)
    except (OSError, pa.ArrowInvalid, KeyError) as error:
        reason = " ".join(str(error).split())[:120]
        raise FaunaError(f"{index} expects the index of {shard.name}, got {reason}; pack the set again") from error


def _photo(shard: Path, values: dict[str, Any]) -> Photo:
    files = {
        kind: Member(shard, values[f"{kind}_name"], values[f"{kind}_offset"], values[f"{kind}_size"])
        for kind in KINDS
        if values[f"{kind}_name"] is not None
    }
    source = FileSource(files["rgb"], files["mask"], files.get("box"), files.get("keypoints"))
    return Photo(values["name"], values["category"], values["photograph"], source, files.get("feat16"))
