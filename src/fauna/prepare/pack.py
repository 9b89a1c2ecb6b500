"""Packing a finished set into few large files: tar shards with an index, which ``data=fauna`` reads as it reads the folder."""

import hashlib
import json
import os
import shutil
import tarfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from fauna.data.fauna_folder import KEYPOINT_NAMES, read_fauna_folder
from fauna.data.packed import FILE, KINDS, LISTS, TEXTS, VERSION, is_packed
from fauna.data.photos import FileSource, Photo
from fauna.errors import FaunaError
from fauna.prepare.finished import FolderSet
from fauna.prepare.settings import Settings
from fauna.prepare.workspace import PARTIAL, file_digest, write_file

PATTERN = r"(.+_\d+)_\d+"
"""How a stem names its photograph, as in ``conf/data/fauna.yaml``; the files of fauna-prepare need none."""
SCHEMA = pa.schema(
    [*((name, pa.string()) for name in TEXTS)]
    + [field for kind in KINDS for field in ((f"{kind}_name", pa.string()), (f"{kind}_offset", pa.int64()), (f"{kind}_size", pa.int64()))]
)  # fmt: skip


@dataclass(frozen=True)
class Entry:
    """A crop to be packed.

    Attributes:
        category: species.
        which: list of :data:`fauna.data.packed.LISTS`.
        photo: with files.
        files: path of each kind of file it has.
        size: of its files, bytes.
    """

    category: str
    which: str
    photo: Photo
    files: dict[str, Path]
    size: int

    def member(self, kind: str) -> str:
        """Name in the tar: what stands before the first dot is the same for all files of the crop."""
        path = self.files[kind]
        stem = self.files["rgb"].stem.removesuffix("rgb").removesuffix("_") or "crop"
        folder = "/".join(self.photo.name.split("/")[1:-1])  # without the set's name
        return f"{folder}/{stem.replace('.', '-')}.{kind}{path.suffix.lower()}"


def pack_set(dest: Path, packed: Path, settings: Settings) -> None:
    """Pack a set; shards that are there already with the same content are left alone, and an interrupted run goes on.

    Args:
        dest: a finished set: a folder of crops without a manifest could be half of anything.
        packed: folder of the shards, made if missing; what else lies in it is left alone.
        settings: group ``pack``.

    Raises:
        FaunaError: when ``dest`` is no finished set, or ``packed`` is no folder for shards.
    """
    _expect_finished(dest)
    inside = packed.resolve().is_relative_to(dest.resolve()) or dest.resolve().is_relative_to(packed.resolve())
    begun = packed.is_dir() and (
        not any(packed.iterdir()) or (packed / FILE).is_file() or any(packed.glob("[0-9]" * 5 + ".tar"))
    )
    if inside or (packed.exists() and not begun):
        raise FaunaError(f"{packed}: expected a new folder for the shards, got something else; choose another")
    packed.mkdir(parents=True, exist_ok=True)
    parts = enumerate(_shards(entries_of(dest), settings.pack.shard_bytes))
    shards = [_pack(entries, packed / f"{number:05d}.tar") for number, entries in parts]
    if (dest / KEYPOINT_NAMES).is_file():
        write_file(packed / KEYPOINT_NAMES, (dest / KEYPOINT_NAMES).read_bytes())
    for manifest in sorted(dest.glob("manifest*.parquet")):
        if file_digest(manifest) != file_digest(packed / manifest.name):
            _copy(manifest, packed / manifest.name)
    content = {"format": "fauna-packed", "version": VERSION, "photos": sum(each["photos"] for each in shards)}
    write_file(packed / FILE, (json.dumps({**content, "shards": shards}, indent=1) + "\n").encode())
    _remove_others(packed, {str(each["file"]) for each in shards})


def _expect_finished(dest: Path) -> None:
    """Refuse what is not, crop by crop, what its manifest says; what is in the files is for ``check`` to see."""
    if is_packed(dest):
        raise FaunaError(f"DEST: expected a set in folders, got {dest}, which is packed; give the set it was made of")
    found = FolderSet(root=dest)
    wrong = next(found.missing(), None)
    told = None if wrong is None else f"{wrong} is missing"
    told = told or next((f"{crop} is not in its manifest" for crop, stray in found.strays() if stray), None)
    if told is not None:
        raise FaunaError(f"{dest}: expected a finished set, got one in which {told}; run fauna-prepare all, then check")


def entries_of(dest: Path) -> Iterator[Entry]:
    """Every crop of a set by species, list and path.

    Raises:
        FaunaError: when there is none, or a mask is missing.
    """
    for category, photos in read_fauna_folder(dest, photograph_pattern=PATTERN).items():
        for which in LISTS:
            for photo in getattr(photos, which):
                source = photo.source
                assert isinstance(source, FileSource)
                given = (source.image, source.mask, source.box, source.keypoints, photo.feature_map)
                files = {kind: path for kind, path in zip(KINDS, given, strict=True) if isinstance(path, Path)}
                yield Entry(category, which, photo, files, sum(_size(path) for path in files.values()))


def _shards(entries: Iterator[Entry], most: int) -> Iterator[list[Entry]]:
    """Entries in their order, in parts of about ``most`` bytes."""
    held: list[Entry] = []
    total = 0
    for entry in entries:
        if held and total + entry.size > most:
            yield held
            held, total = [], 0
        held.append(entry)
        total += entry.size
    if held:
        yield held


def _pack(entries: Sequence[Entry], path: Path) -> dict[str, Any]:
    """Write a shard and its index; what ``packed.json`` says about it."""
    stamp = path.with_name(f".{path.stem}.stamp")
    wanted = _stamp(entries)
    facts = _known(stamp, wanted, path)
    if facts is not None:
        return facts
    partial = path.with_name(f".{path.name}-{os.getpid()}{PARTIAL}")
    try:
        rows = _write_tar(entries, partial)
        digest = file_digest(partial)
        partial.replace(path)
    finally:
        with suppress(OSError):
            partial.unlink()
    table = pa.Table.from_pylist(rows, schema=SCHEMA)
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    index = sink.getvalue().to_pybytes()
    write_file(path.with_suffix(".parquet"), index)
    facts = {"file": path.name, "bytes": path.stat().st_size, "photos": len(entries), "sha256": digest}
    noted = {"stamp": wanted, "facts": facts, "index": hashlib.sha256(index).hexdigest()}
    write_file(stamp, json.dumps(noted).encode())
    return facts


def _write_tar(entries: Sequence[Entry], path: Path) -> list[dict[str, Any]]:
    """Files side by side, without times, owners or modes of their own: the same set gives the same bytes."""
    rows = []
    with tarfile.open(path, "w", format=tarfile.PAX_FORMAT) as tar:
        for entry in entries:
            row: dict[str, Any] = dict.fromkeys(SCHEMA.names)
            row |= {"category": entry.category, "list": entry.which, "name": entry.photo.name}
            row["photograph"] = entry.photo.photograph
            for kind, file in entry.files.items():
                info = tarfile.TarInfo(entry.member(kind))
                with file.open("rb") as handle:
                    info.size = os.fstat(handle.fileno()).st_size
                    head = len(info.tobuf(tar.format, tar.encoding, tar.errors))
                    row |= {f"{kind}_name": info.name, f"{kind}_offset": tar.offset + head, f"{kind}_size": info.size}
                    tar.addfile(info, handle)
            rows.append(row)
    return rows


def _stamp(entries: Sequence[Entry]) -> str:
    """Digest of what a shard is made of, told without reading: paths, sizes, times."""
    digest = hashlib.blake2b(digest_size=16)
    for entry in entries:
        for file in entry.files.values():
            found = file.stat()
            digest.update(f"{file}\0{found.st_size}\0{found.st_mtime_ns}\0".encode("utf-8", "surrogateescape"))
    return digest.hexdigest()


def _known(stamp: Path, wanted: str, path: Path) -> dict[str, Any] | None:
    """What was said about a shard that was made of the same files and is whole, as its index is."""
    try:
        content = json.loads(stamp.read_text(encoding="utf-8"))
        facts, index = content["facts"], file_digest(path.with_suffix(".parquet"))
        same = content["stamp"] == wanted and index is not None and index == content["index"]
        return facts if same and file_digest(path) == facts["sha256"] else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _remove_others(packed: Path, kept: set[str]) -> None:
    """Remove shards of an earlier, larger packing."""
    for path in sorted(packed.glob("[0-9][0-9][0-9][0-9][0-9].tar")):
        if path.name not in kept:
            for each in (path, path.with_suffix(".parquet"), path.with_name(f".{path.stem}.stamp")):
                each.unlink(missing_ok=True)


def _copy(source: Path, target: Path) -> None:
    partial = target.with_name(f".{target.name}-{os.getpid()}{PARTIAL}")
    try:
        shutil.copyfile(source, partial)
        partial.replace(target)
    finally:
        with suppress(OSError):
            partial.unlink()


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError as error:
        raise FaunaError(f"{path}: expected a file of a crop, got {error.strerror}; run fauna-prepare check") from error
