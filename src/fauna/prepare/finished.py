"""Where the files of a finished set lie: in folders, or in the tar files of a packed one. An audit asks both the same."""

import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path

from fauna.data.fauna_folder import IMAGE_NAME
from fauna.data.packed import KINDS, is_packed, read_index, read_shards
from fauna.data.photos import FileSource, Photo
from fauna.data.stored import Member, StoredFile
from fauna.errors import FaunaError
from fauna.prepare.place import crop_path, files_of, manifest_files
from fauna.prepare.record import Record
from fauna.prepare.tables import read_columns, read_table
from fauna.prepare.workspace import file_digest

Crop = tuple[int, ...]
"""Number of the shard, then first byte and size of every kind of file, -1 where there is none."""


class FinishedSet(ABC):
    """The files of a set by the rows of its manifest.

    Args:
        root: folder of the set.

    Attributes:
        manifest: its files.
        joint: clusters of several usable animals: these have folders.

    Raises:
        FaunaError: when there is no manifest.
    """

    def __init__(self, *, root: Path) -> None:
        self.root = root
        self.manifest = manifest_files(root)
        if not self.manifest:
            raise FaunaError(
                f"{root}: expected a set of fauna-prepare with a manifest.parquet, got none; run fauna-prepare all"
            )
        self.joint = _joint(self.manifest)

    @abstractmethod
    def file(self, row: Record, end: str) -> StoredFile:
        """A file of a crop, ``end`` of :data:`fauna.prepare.workspace.CROP_FILES`; whether it is there shows when it is read.

        Raises:
            OSError: when it is not there.
        """

    @abstractmethod
    def crops(self) -> Iterator[str]:
        """Every crop that training would read, named as by :meth:`name`."""

    def containers(self) -> Iterator[tuple[str, str | None]]:
        """Files that hold many others: name, and what is wrong with it."""
        return iter(())

    def rows(self) -> Iterator[Record]:
        """The rows that are used."""
        for file in self.manifest:
            yield from (row for row in read_table(file) if row.ok)

    def name(self, row: Record) -> str:
        """Of a crop: species, split and stem."""
        return crop_path(row, "", self.joint).removesuffix("_")

    def strays(self) -> Iterator[tuple[str, bool]]:
        """Every crop, and whether the manifest does not know it."""
        known = {self.name(row) for row in self.rows()}
        for crop in self.crops():
            yield crop, crop not in known

    def missing(self) -> Iterator[str]:
        """Files that the manifest has and the set has not."""
        for row in self.rows():
            for end in files_of(row):
                try:
                    there = self.file(row, end).is_file()
                except OSError:
                    there = False
                if not there:
                    yield f"{self.name(row)}_{end}"


class FolderSet(FinishedSet):
    """DEST of ``fauna-prepare all``."""

    def file(self, row: Record, end: str) -> StoredFile:
        """By :func:`fauna.prepare.place.crop_path`."""
        return self.root / crop_path(row, end, self.joint)

    def crops(self) -> Iterator[str]:
        """By their pictures, of whatever suffix."""
        for folder, _, names in os.walk(self.root):
            for name in names:
                path = Path(folder, name).relative_to(self.root)
                if IMAGE_NAME.match(name) and len(path.parts) > 1:
                    ours = path.as_posix().endswith("_rgb.jpg")
                    yield path.as_posix().removesuffix("_rgb.jpg") if ours else path.as_posix()


class PackedSet(FinishedSet):
    """What ``fauna-prepare pack`` wrote; memory is some 300 bytes a crop.

    Raises:
        FaunaError: when the list of shards is damaged.
    """

    def __init__(self, *, root: Path) -> None:
        super().__init__(root=root)
        self._shards = read_shards(root)
        self._faults: dict[str, str | None] = {}
        self._crops: dict[str, Crop] = {}
        for number, entry in enumerate(self._shards):
            name = str(entry["file"])
            self._faults[name] = self._fault(entry)
            try:
                for _, _, photo in read_index(root / name):
                    crop, places = _located(photo, number)
                    self._crops[crop] = places
            except FaunaError as error:
                self._faults[name] = str(error)

    def file(self, row: Record, end: str) -> StoredFile:
        """Where the index says."""
        name, kind = self.name(row), KINDS.index(end.split(".")[0])
        shard, *places = self._crops.get(name, (0, *[-1] * 2 * len(KINDS)))
        offset, size = places[2 * kind : 2 * kind + 2]
        if offset < 0:
            raise FileNotFoundError(2, "in no shard", f"{name}.{end}")
        return Member(self.root / str(self._shards[shard]["file"]), f"{name}.{end}", offset, size)

    def crops(self) -> Iterator[str]:
        """In the order of the shards."""
        return iter(self._crops)

    def containers(self) -> Iterator[tuple[str, str | None]]:
        """Shards by their size and digest."""
        return iter(self._faults.items())

    def _fault(self, entry: dict) -> str | None:
        path = self.root / str(entry["file"])
        if not path.is_file():
            return "is not there"
        return None if file_digest(path) == entry["sha256"] else "changed since it was packed"


def open_set(root: Path) -> FinishedSet:
    """The set of a folder, packed or not; raises as :class:`FinishedSet` does."""
    return PackedSet(root=root) if is_packed(root) else FolderSet(root=root)


def _located(photo: Photo, shard: int) -> tuple[str, Crop]:
    source = photo.source
    assert isinstance(source, FileSource)
    assert isinstance(source.image, Member)
    places: list[int] = []
    for file in (source.image, source.mask, source.box, source.keypoints, photo.feature_map):
        places += [file.offset, file.size] if isinstance(file, Member) else [-1, -1]
    return source.image.name.rsplit(".", 2)[0], (shard, *places)


def _joint(files: list[Path]) -> frozenset[str]:
    seen: set[str] = set()
    twice: set[str] = set()
    for file in files:
        for part in read_columns(file, ["photo", "cluster", "status"]):
            for photo, cluster, status in zip(*part.values(), strict=True):
                if status == "ok":
                    name = cluster or photo
                    (twice if name in seen else seen).add(name)
    return frozenset(twice)
