"""Archives as SOURCE: unpacked below WORK, and only what stays there."""

import json
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import IO

from fauna.errors import FaunaError
from fauna.prepare.workspace import write_file

SUFFIXES = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tar.xz")
LIST = "unpacked.json"
"""Beside the folder, written last: the archive is unpacked, and what was refused."""
MAX_MEMBERS = 20_000_000


def is_archive(path: Path) -> bool:
    """Whether a file's name is that of an archive."""
    return path.is_file() and path.name.lower().endswith(SUFFIXES)


def unpack(archive: Path, folder: Path, *, max_bytes: int) -> tuple[tuple[str, str], ...]:
    """Unpack the plain files of an archive; nothing is done where that was done before.

    Args:
        archive: ZIP or tar.
        folder: of its content.
        max_bytes: of all files together.

    Returns:
        (name, reason) of what was refused: names that lead outside, links, devices, encrypted files.

    Raises:
        FaunaError: when it is damaged or holds more than ``max_bytes``.
    """
    stamp = {"archive": archive.name, "bytes": archive.stat().st_size}
    note = folder.with_name(f"{folder.name}-{LIST}")
    try:
        known = json.loads(note.read_text(encoding="utf-8"))
        if known["stamp"] == stamp:
            return tuple((name, reason) for name, reason in known["refused"])
    except (OSError, ValueError, KeyError):
        pass
    refused: list[tuple[str, str]] = []
    left = max_bytes
    try:
        for name, reason, handle, size in _members(archive):
            if reason is None:
                reason = refusal(name)
            if reason is not None:
                refused.append((name, reason))
                continue
            assert handle is not None
            left -= size
            content = handle.read(min(size, left + 1) + 1) if left >= 0 else b""
            if left < 0 or len(content) > size:
                raise FaunaError(
                    f"{archive} expects at most {max_bytes:,} bytes of files, got more; raise source.max_archive_bytes"
                )
            write_file(folder.joinpath(*PurePosixPath(name).parts), content)
    except (tarfile.TarError, zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError, ValueError) as error:
        reason = " ".join(str(error).split())[:120]
        raise FaunaError(
            f"{archive} expects a whole archive, got a damaged one ({reason}); download it again"
        ) from error
    write_file(note, json.dumps({"stamp": stamp, "refused": refused}).encode())
    return tuple(refused)


def refusal(name: str) -> str | None:
    r"""Why a name in an archive is refused, ``None`` for a good one.

    >>> refusal("horse/1.jpg"), refusal("../1.jpg"), refusal("C:\\1.jpg")
    (None, 'leads outside of the archive', 'leads outside of the archive')
    """
    path = PurePosixPath(name.replace("\\", "/"))
    if path.is_absolute() or ".." in path.parts or ":" in name.split("/")[0] or "\0" in name or "\\" in name:
        return "leads outside of the archive"
    if not path.parts or any(len(part.encode("utf-8", "surrogateescape")) > 255 for part in path.parts):
        return "has no name that a file can have"
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
