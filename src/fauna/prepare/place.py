"""The finished set: crops by species and split in DEST, the manifest beside them, nothing else and nothing twice."""

import contextlib
import errno
import hashlib
import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from fauna.errors import FaunaError
from fauna.prepare.record import Record
from fauna.prepare.split import cluster_of
from fauna.prepare.tables import write_table
from fauna.prepare.workspace import CROP_FILES, PARTIAL, Workspace, file_digest

OURS = re.compile(r"[0-9a-f]{16}_\d{2,}_(" + "|".join(re.escape(end) for end in CROP_FILES) + ")")
MANIFEST = re.compile(r"manifest(-\d{5}-of-\d{5})?\.parquet")
DIGESTS = {"rgb.jpg": "rgb_sha256", "mask.png": "mask_sha256", "feat16.png": "feat_sha256"}
"""Ends of files whose digest stands in the manifest, and the attribute."""
LAST = "rgb.jpg"
"""Readers look for this file, so it comes last and goes first."""


def crop_path(row: Record, end: str, joint: frozenset[str] | set[str]) -> str:
    """Where a file of a crop lies below DEST.

    Args:
        row: of the crop, with its split.
        end: of :data:`fauna.prepare.workspace.CROP_FILES`.
        joint: clusters of several animals; they get a folder, which ``data=fauna`` takes for one photograph.
    """
    cluster = cluster_of(row)
    folder = f"{cluster}/" if cluster in joint else ""
    return f"{row.species}/{row.split}/{folder}{row.id}_{end}"


def files_of(row: Record) -> tuple[str, ...]:
    """Ends of the files that a row has, in the order in which they are placed."""
    ends = ["mask.png", "box.txt"]
    ends += ["keypoints.json"] if row.keypoints is not None else []
    ends += ["feat16.png"] if row.feat_sha256 is not None else []
    return (*ends, LAST)


def place(
    rows: Callable[[], Iterable[Record]], joint: frozenset[str], workspace: Workspace, tick: Callable[[], None]
) -> int:
    """Bring DEST to what the rows say: files that no row has are removed first, then the missing ones are placed.

    Files are linked, or copied where the file system has no links; what is there with the same bytes is left alone. Memory is 8 bytes
    a file.

    Args:
        rows: gives all rows of the set with their splits, every time it is called.
        joint: see :func:`crop_path`.
        workspace: the folders.
        tick: called after every row.

    Returns:
        How many files were placed anew.

    Raises:
        FaunaError: when a crop is missing in the work folder, or is not the one that was made.
    """
    for left in workspace.work.glob(f".*{PARTIAL}"):
        left.unlink(missing_ok=True)
    _sweep(workspace.dest, _wanted(rows(), joint))
    placed = 0
    for row in rows():
        if row.ok:
            for end in files_of(row):
                placed += _placed(row, end, joint, workspace)
        tick()
    return placed


def write_manifest(rows: Iterable[Record], workspace: Workspace, count: int, rows_per_file: int) -> list[Path]:
    """The manifest: ``manifest.parquet``, or several files of so many rows; files with the same bytes are left alone.

    It is written in the work folder, so that DEST is not even touched where nothing changed.

    Args:
        rows: all of the set, by photo and instance.
        workspace: whose DEST the files are for.
        count: how many rows there are.
        rows_per_file: that one file holds at most.
    """
    files = max(-(-count // rows_per_file), 1)
    names = ["manifest.parquet"] if files == 1 else [f"manifest-{i:05d}-of-{files:05d}.parquet" for i in range(files)]
    stream = iter(rows)
    for name in names:
        new = workspace.work / "manifest" / name
        write_table(new, _first(stream, rows_per_file))
        if not _same(new, workspace.dest / name):
            _copy(new, workspace.dest / name)
        new.unlink()
    for path in workspace.dest.iterdir():
        if MANIFEST.fullmatch(path.name) and path.name not in names:
            path.unlink()
    return [workspace.dest / name for name in names]


def manifest_files(dest: Path) -> list[Path]:
    """The files of a set's manifest in order; none when there is no set."""
    return sorted(path for path in dest.iterdir() if MANIFEST.fullmatch(path.name)) if dest.is_dir() else []


def _first(stream: Iterator[Record], count: int) -> Iterator[Record]:
    for _, row in zip(range(count), stream, strict=False):
        yield row


def _wanted(rows: Iterable[Record], joint: frozenset[str]) -> np.ndarray:
    names = (crop_path(row, end, joint) for row in rows if row.ok for end in files_of(row))
    return np.sort(np.fromiter((_digest(name) for name in names), np.uint64))


def _digest(name: str) -> int:
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "big")


def _sweep(dest: Path, wanted: np.ndarray) -> None:
    """Remove our files that are not wanted, and folders that are empty then. Files of other names are not ours."""
    for folder, _, names in os.walk(dest, topdown=False):
        base = Path(folder)
        for name in sorted(names, key=lambda each: not each.endswith(LAST)):
            killed = name.startswith(".") and name.endswith(PARTIAL)
            ours = OURS.fullmatch(name) is not None
            if killed or (ours and not _has(wanted, (base / name).relative_to(dest).as_posix())):
                (base / name).unlink()
        if base != dest:
            with contextlib.suppress(OSError):
                base.rmdir()


def _has(wanted: np.ndarray, name: str) -> bool:
    value = np.uint64(_digest(name))
    index = int(np.searchsorted(wanted, value))
    return index < len(wanted) and bool(wanted[index] == value)


def _placed(row: Record, end: str, joint: frozenset[str], workspace: Workspace) -> bool:
    """Place a file of a crop; whether it was not there before.

    Raises:
        FaunaError: when the work folder no longer has what was made; the file in DEST may be the same one by a link, and damaged too.
    """
    source, target = workspace.crop(row.id, end), workspace.dest / crop_path(row, end, joint)
    digest = getattr(row, DIGESTS[end]) if end in DIGESTS else None
    if digest is not None and file_digest(source) not in (digest, None):
        raise FaunaError(f"{source}: expected the file that was made, got other bytes; run fauna-prepare all again")
    return _link(source, target, workspace)


def _link(source: Path, target: Path, workspace: Workspace) -> bool:
    if _same(source, target):
        return False
    partial = workspace.work / f".{target.name}.{os.getpid()}{PARTIAL}"
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        partial.unlink(missing_ok=True)
        try:
            os.link(source, partial)
            partial.replace(target)
        except FileNotFoundError as error:
            raise FaunaError(
                f"{source}: expected a crop, got nothing there; remove the folder {workspace.work} and run again"
            ) from error
        except OSError as error:
            if error.errno not in (errno.EXDEV, errno.EPERM, errno.ENOTSUP, errno.EMLINK):
                raise
            _copy(source, target)
    finally:
        partial.unlink(missing_ok=True)
    return True


def _copy(source: Path, target: Path) -> None:
    """By way of a hidden file beside the target, where work folder and set may lie on different disks."""
    partial = target.with_name(f".{target.name}.{os.getpid()}{PARTIAL}")
    try:
        shutil.copyfile(source, partial)
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def _same(first: Path, second: Path) -> bool:
    try:
        a, b = first.stat(), second.stat()
    except OSError:
        return False
    if (a.st_dev, a.st_ino) == (b.st_dev, b.st_ino):
        return True
    return a.st_size == b.st_size and file_digest(first) == file_digest(second)
