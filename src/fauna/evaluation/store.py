"""Named bundles of arrays on disk: compressed npz shards and one ``index.json``, each written by renaming a finished file.

A store that was interrupted holds every shard that was finished and goes on from there.
"""

import hashlib
import io
import json
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fauna.data.feature_cache import write_atomically
from fauna.errors import FaunaError

FORMAT = 1
SHARD_SIZE = 16
"""Items of a shard: what an interruption can cost."""
UNREADABLE = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error)
"""What reading arrays from a missing or damaged file raises."""


@dataclass(frozen=True)
class Item:
    """One bundle.

    Attributes:
        name: unique within the store.
        arrays: by name.
        notes: what fits into JSON.
    """

    name: str
    arrays: Mapping[str, np.ndarray]
    notes: Mapping[str, Any] = field(default_factory=dict)


class ArrayStore:
    """A folder of bundles.

    Args:
        folder: made when the first shard is written.
        identity: what the bundles belong to, JSON values; a folder with another identity is refused. ``None`` accepts
            what is there and is for reading.
        renewed_by: parts of the identity; bundles that differ in nothing else are forgotten instead of refused.

    Raises:
        FaunaError: when the folder holds another format or identity.
    """

    def __init__(self, folder: Path, *, identity: Mapping[str, Any] | None, renewed_by: Sequence[str] = ()) -> None:
        self.folder = folder
        self._renewed_by = tuple(renewed_by)
        self._shards: list[dict[str, Any]] = []
        self._pending: list[Item] = []
        self.identity: dict[str, Any] = {} if identity is None else json.loads(json.dumps(identity))
        if identity is None or self._index.is_file():
            self._open(check=identity is not None)

    @property
    def _index(self) -> Path:
        return self.folder / "index.json"

    @property
    def names(self) -> list[str]:
        """Names of all bundles, in the order they were added."""
        stored = [entry["name"] for shard in self._shards for entry in shard["items"]]
        return stored + [item.name for item in self._pending]

    def add(self, item: Item) -> None:
        """Append a bundle; every :data:`SHARD_SIZE` of them are written out."""
        self._pending.append(item)
        if len(self._pending) >= SHARD_SIZE:
            self.flush()

    def flush(self) -> None:
        """Write what is pending: first the shard, then the index that names it."""
        if not self._pending and self._index.is_file():
            return
        if self._pending:
            file = f"shard-{len(self._shards):05d}.npz"
            buffer = io.BytesIO()
            arrays = {f"{place}|{key}": a for place, item in enumerate(self._pending) for key, a in item.arrays.items()}
            np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
            write_atomically(self.folder / file, buffer.getvalue())
            items = [{"name": item.name, "notes": dict(item.notes)} for item in self._pending]
            self._shards.append({"file": file, "items": items})
            self._pending = []
        content = {"format": FORMAT, "identity": self.identity, "shards": self._shards}
        write_atomically(self._index, (json.dumps(content, indent=1) + "\n").encode())

    def items(self) -> Iterator[Item]:
        """All bundles, in the order they were added.

        Raises:
            FaunaError: when a shard is missing or damaged.
        """
        for shard in self._shards:
            path = self.folder / shard["file"]
            try:
                with np.load(io.BytesIO(path.read_bytes())) as content:
                    arrays: dict[int, dict[str, np.ndarray]] = {}
                    for key in content.files:
                        place, _, name = key.partition("|")
                        arrays.setdefault(int(place), {})[name] = content[key]
            except UNREADABLE as error:
                raise FaunaError(
                    f"{path} expects a readable shard, got {type(error).__name__}; delete {self.folder} and evaluate anew"
                ) from error
            for place, entry in enumerate(shard["items"]):
                yield Item(entry["name"], arrays.get(place, {}), entry["notes"])
        yield from self._pending

    def _open(self, *, check: bool) -> None:
        try:
            content = json.loads(self._index.read_text(encoding="utf-8"))
            version, found, shards = content["format"], content["identity"], content["shards"]
        except FileNotFoundError as error:
            raise FaunaError(
                f"predictions: expected a folder with index.json, got {self.folder} without one; "
                "name the predictions folder of an evaluation"
            ) from error
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise FaunaError(
                f"{self._index} expects an index of format {FORMAT}, got a broken one; delete the folder"
            ) from error
        if version != FORMAT:
            raise FaunaError(f"{self._index} expects format {FORMAT}, got {version}; evaluate anew into another out")
        differ = [key for key in sorted({*found, *self.identity}) if found.get(key) != self.identity.get(key)]
        if check and differ and set(differ) <= set(self._renewed_by):
            self._index.unlink()  # its shards are written over
            return
        if check and differ:
            key = next(key for key in differ if key not in self._renewed_by)
            raise FaunaError(
                f"out: expected a new folder or the same evaluation, got {self.folder} made with {key} "
                f"{found.get(key)!r} instead of {self.identity.get(key)!r}; choose another out"
            )
        self.identity, self._shards = found, shards


def names_digest(names: Iterable[str]) -> str:
    """Digest of a set of names, for identities."""
    return hashlib.sha256("\n".join(sorted(names)).encode()).hexdigest()
