"""Archives as SOURCE: unpacked below WORK, and only what stays there."""

import errno
import json
import lzma
import shutil
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import IO, Any

from fauna.errors import FaunaError
from fauna.prepare.locks import one_at_a_time
from fauna.prepare.workspace import write_file

SUFFIXES = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tar.xz")
LIST = "unpacked.json"
"""Beside the folder, written last: the archive is unpacked, and what was refused."""
MAX_MEMBERS = 20_000_000
NO_NAME = "has no name that a file can have"
DAMAGED = (
    tarfile.TarError, zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError, RuntimeError, ValueError, OSError,
)  # fmt: skip
"""What a damaged archive makes the readers raise; errors of the machine are told by their number."""


def is_archive(path: Path) -> bool:
    """Whether a file's name is that of an archive."""
    return path.is_file() and path.name.lower().endswith(SUFFIXES)


def unpack(archive: Path, folder: Path, *, max_bytes: int) -> tuple[tuple[str, str], ...]:
    """Unpack the plain files of an archive; nothing is done where that was done before.

    What was unpacked of another archive, or of this one before it changed, is removed first. Where several processes come at once,
    one unpacks and the others wait.

    Args:
        archive: ZIP or tar.
        folder: of its content.
        max_bytes: of all files together.

    Returns:
        (name, reason) of what was refused: names that lead outside or that no file can have, links, devices, encrypted files.

    Raises:
        FaunaError: when it is damaged or holds more than ``max_bytes``.
    """
    found = archive.stat()
    stamp = {"archive": archive.name, "bytes": found.st_size, "mtime_ns": found.st_mtime_ns}
    note = folder.with_name(f"{folder.name}-{LIST}")
    with one_at_a_time(folder.with_name(f"{folder.name}.lock")):
        known = _note(note)
        if known.get("stamp") != stamp:
            shutil.rmtree(folder, ignore_errors=True)
            write_file(note, json.dumps({"stamp": stamp}).encode())  # begun: what is unpacked now is of this archive
        elif "refused" in known:
            return tuple((name, reason) for name, reason in known["refused"])
        refused = _unpacked(archive, folder, max_bytes)
        write_file(note, json.dumps({"stamp": stamp, "refused": refused}).encode())
    return tuple(refused)


def _note(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _unpacked(archive: Path, folder: Path, max_bytes: int) -> list[tuple[str, str]]:
    """Write the files; what was refused."""
    refused: list[tuple[str, str]] = []
    left = max_bytes
    try:
        for name, told, handle, size in _members(archive):
            reason = refusal(name) if told is None else told
            if reason is None:
                assert handle is not None
                left -= size
                content = handle.read(min(size, left + 1) + 1) if left >= 0 else b""
                if left < 0 or len(content) > size:
                    raise FaunaError(
                        f"{archive} expects at most {max_bytes:,} bytes of files, got more; raise source.max_archive_bytes"
                    )
                reason = _written(folder.joinpath(*PurePosixPath(name).parts), content)
            if reason is not None:
                refused.append((name, reason))
    except DAMAGED as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        reason = " ".join(str(error).split())[:120]
        raise FaunaError(
            f"{archive} expects a whole archive, got a damaged one ({reason}); download it again"
        ) from error
    return refused


def _written(path: Path, content: bytes) -> str | None:
    """Why a file could not be written under its name, ``None`` when it was."""
    try:
        write_file(path, content)
    except (NotADirectoryError, IsADirectoryError, FileExistsError):
        return "has the name of a folder and of a file at once"
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        return NO_NAME
    return None


def refusal(name: str) -> str | None:
    r"""Why a name in an archive is refused, ``None`` for a good one.

    >>> refusal("horse/1.jpg"), refusal("../1.jpg"), refusal("C:\\1.jpg")
    (None, 'leads outside of the archive', 'leads outside of the archive')
    """
    path = PurePosixPath(name.replace("\\", "/"))
    if path.is_absolute() or ".." in path.parts or ":" in name.split("/")[0] or "\0" in name or "\\" in name:
        return "leads outside of the archive"
    if not path.parts or any(len(part.encode("utf-8", "surrogateescape")) > 255 for part in path.parts):
        return NO_NAME
    return None


def _members(archive: Path) -> Iterator[tuple[str, str | None, IO[bytes] | None, int]]:
    """Name, reason against it, content and size of every file; folders are passed over."""
    if archive.name.lower().endswith(".zip"):
        with zipfile.ZipFile(archive) as zipped:
            for info in zipped.infolist()[:MAX_MEMBERS]:
                if info.is_dir():
                    continue
                kind = (info.external_attr >> 28) & 0xF  # of Unix: 8 is a plain file, 0 is not told
                reason = None if kind in (0, 8) else "is a link or a device"
                reason = "is encrypted" if info.flag_bits & 1 else reason
                if reason is None:
                    with zipped.open(info) as handle:
                        yield info.filename, None, handle, info.file_size
                else:
                    yield info.filename, reason, None, 0
        return
    with tarfile.open(archive, "r:*") as tarred:
        for member in tarred:
            if member.isdir():
                continue
            handle = tarred.extractfile(member) if member.isreg() else None
            yield member.name, None if handle is not None else "is a link or a device", handle, member.size
