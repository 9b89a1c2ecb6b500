"""Where things are: SOURCE is only read, DEST holds the finished set and nothing else, WORK everything on the way to it."""

import contextlib
import hashlib
import os
import re
from dataclasses import dataclass
from pathlib import Path

from fauna.prepare.shard import Shard

PARTIAL = ".partial"
CROP_FILES = ("rgb.jpg", "mask.png", "box.txt", "keypoints.json", "feat16.png")
"""Ends of the names of a crop's files."""


@dataclass(frozen=True)
class Workspace:
    """The three folders.

    Attributes:
        source: the pile of photographs; a file for some sources.
        dest: a valid ``data.root`` of ``data=fauna`` once everything is done; files appear in it whole.
        work: tables, journals, masks, crops, reports and timings.
    """

    source: Path
    dest: Path
    work: Path

    def photo(self, source: str) -> Path:
        """A file below SOURCE by its text in the manifest; ``work:...`` are files that a source unpacked (frames, archives)."""
        if source.startswith("work:"):
            return self.work / path_of_text(source.removeprefix("work:"))
        return self.root / path_of_text(source)

    @property
    def root(self) -> Path:
        """The folder that texts of paths start from: SOURCE, or the folder of the file that it is."""
        return self.source.parent if self.source.is_file() else self.source

    def table(self, stage: str, shard: Shard) -> Path:
        """Parquet of all rows of a shard after a stage."""
        return self.work / "tables" / stage / f"{shard.stem}.parquet"

    def journal(self, stage: str, shard: Shard) -> Path:
        """Lines of the photographs that are done, while a stage runs."""
        return self.work / "journals" / stage / f"{shard.stem}.jsonl"

    def mask(self, row: str) -> Path:
        """Mask of an animal: 1-bit PNG of the photograph at working size."""
        return self.work / "masks" / row[:2] / f"{row}.png"

    def crop(self, row: str, end: str) -> Path:
        """A file of a crop, before it is placed in DEST; ``end`` of :data:`CROP_FILES`."""
        return self.work / "crops" / row[:2] / f"{row}_{end}"

    @property
    def report(self) -> Path:
        """Plots, contact sheets and tables for people."""
        return self.work / "report"

    @property
    def unpacked(self) -> Path:
        """What sources unpack: frames of video files, archives."""
        return self.work / "unpacked"

    @property
    def logs(self) -> Path:
        """Timings; nothing reads them."""
        return self.work / "logs"


def write_file(path: Path, content: bytes) -> None:
    """Write a file that is either complete or absent, also after a crash. What is there already with the same bytes is left alone.

    Raises:
        OSError: when it cannot be written, e.g. on a full disk; nothing is left behind then.
    """
    with contextlib.suppress(OSError):
        if path.stat().st_size == len(content) and path.read_bytes() == content:
            return
    partial = path.with_name(f".{path.name[:40]}.{os.getpid()}{PARTIAL}")  # jobs of one set may write the same file
    try:
        try:
            partial.write_bytes(content)
        except FileNotFoundError:
            path.parent.mkdir(parents=True, exist_ok=True)
            partial.write_bytes(content)
        partial.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            partial.unlink()
        raise


def file_digest(path: Path) -> str | None:
    """SHA-256 of a file's content as hexadecimal digits, ``None`` where it cannot be read."""
    try:
        digest = hashlib.sha256()
        with path.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    except OSError:
        return None
    return digest.hexdigest()


def shown(text: str) -> str:
    r"""A name for people: one line, whatever letters it has.

    >>> shown("two\nlines \udcff")
    'two\\nlines \\udcff'
    """
    return "".join(letter if letter.isprintable() else letter.encode("unicode_escape").decode() for letter in text)


def text_of_path(path: Path) -> str:
    r"""A relative path as UTF-8 text: bytes that are no UTF-8 as ``%XX``, and ``%`` itself as ``%25``.

    Halves of characters, which no file name has but JSON may spell, become question marks.

    >>> text_of_path(Path("a\udcff/50%.jpg"))
    'a%FF/50%25.jpg'
    """
    text = path.as_posix().replace("%", "%25")
    text = re.sub("[\udc80-\udcff]", lambda match: f"%{ord(match[0]) - 0xDC00:02X}", text)
    return text.encode("utf-8", "replace").decode()


def path_of_text(text: str) -> Path:
    """The path of a text.

    >>> path_of_text("a/50%25.jpg").as_posix()
    'a/50%.jpg'
    """
    decoded = re.sub("%([0-9A-F]{2})", lambda m: "%" if m[1] == "25" else chr(0xDC00 + int(m[1], 16)), text)
    return Path(decoded)
