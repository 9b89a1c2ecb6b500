"""The audit of a finished set: is everything there that its manifest says, is it sound, and does nothing leak between splits."""

import contextlib
import hashlib
import io
import json
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image
from rich.console import Console
from rich.table import Table
from rich.text import Text

from fauna.data.fauna_folder import KEYPOINT_NAMES, read_keypoint_names
from fauna.data.stored import readable
from fauna.errors import FaunaError
from fauna.prepare.crop import texts_of
from fauna.prepare.finished import FinishedSet, open_set
from fauna.prepare.hashes import near_pairs
from fauna.prepare.place import DIGESTS, files_of
from fauna.prepare.progress import progress
from fauna.prepare.record import Record
from fauna.prepare.settings import Settings
from fauna.prepare.split import BACK, TRAIN, cluster_of
from fauna.prepare.workspace import shown

TILES = 6
"""Of a stored feature map: 16 channels, three in each."""


@dataclass
class Finding:
    """What one check found.

    Attributes:
        looked_at: how many things.
        faults: how many of them are wrong.
        example: the first, in words.
        fatal: whether a fault makes the set unsound.
    """

    looked_at: int = 0
    faults: int = 0
    example: str = ""
    fatal: bool = True

    def look(self, fault: str | None) -> None:
        """Count a thing and what is wrong with it."""
        self.looked_at += 1
        if fault is not None:
            self.faults += 1
            self.example = self.example or fault


@dataclass
class Audit:
    """All findings by name."""

    findings: dict[str, Finding] = field(default_factory=dict)

    def of(self, name: str, *, fatal: bool = True) -> Finding:
        """The finding of a name."""
        return self.findings.setdefault(name, Finding(fatal=fatal))

    @property
    def sound(self) -> bool:
        """Whether no check that counts found a fault."""
        return not any(each.faults and each.fatal for each in self.findings.values())


def check_set(dest: Path, settings: Settings) -> bool:
    """Audit a set and print a table.

    Args:
        dest: folder of a finished set, packed or not.
        settings: group ``check``.

    Returns:
        Whether the set is sound.

    Raises:
        FaunaError: when there is no set.
    """
    audit = audit_set(dest, settings)
    table = Table("check", "looked at", "faults", "first")
    for name, found in audit.findings.items():
        verdict = f"{found.faults:,}" if found.fatal or not found.faults else f"{found.faults:,} (allowed)"
        table.add_row(name, f"{found.looked_at:,}", verdict, Text(shown(found.example)))
    Console().print(table)
    print(f"check: {'sound' if audit.sound else 'NOT SOUND'}, {shown(str(dest))}", flush=True)
    return audit.sound


def audit_set(dest: Path, settings: Settings) -> Audit:
    """All checks; arguments and errors as for :func:`check_set`."""
    found = open_set(dest)
    audit = Audit()
    for name, fault in found.containers():
        audit.of("shards").look(None if fault is None else f"{name}: {fault}")
    names = read_keypoint_names(dest)
    size = _crop_size(found, usual=settings.crop.size)
    with progress("check") as tick:
        for row in found.rows():
            for end in files_of(row):
                _check_file(found, row, end, names, size, audit)
            audit.of("licences", fatal=settings.check.unlicensed == "fail").look(
                f"{row.source}: unknown" if row.licence == "unknown" else None
            )
            tick()
    _check_leaks(found, settings, audit)
    for crop, stray in found.strays():
        audit.of("no strays").look(f"{crop} is not in the manifest" if stray else None)
    return audit


def _crop_size(found: FinishedSet, *, usual: int) -> int:
    """Side of the first crop that can be opened: all others must have it too; ``usual`` where there is none."""
    for row in found.rows():
        with contextlib.suppress(Exception), Image.open(readable(found.file(row, "rgb.jpg"))) as picture:
            return picture.size[0]
    return usual


def _check_file(
    found: FinishedSet, row: Record, end: str, names: tuple[str, ...] | None, size: int, audit: Audit
) -> None:
    try:
        file = found.file(row, end)
        content = file.read_bytes()
    except (OSError, FaunaError) as error:
        told = error.strerror if isinstance(error, OSError) else error
        audit.of("files").look(f"{found.name(row)}_{end}: {told}")
        return
    audit.of("files").look(None if _as_made(row, end, content, size) else f"{file}: changed since it was made")
    examine: Callable[[], str | None] = {
        "rgb.jpg": lambda: _picture(content, size),
        "mask.png": lambda: _mask(content, size),
        "feat16.png": lambda: _features(content),
        "keypoints.json": lambda: _keypoints(content, names),
        "box.txt": lambda: None if len(content.split()) >= 7 else "expected seven numbers",
    }[end]
    try:
        fault = examine()
    except Exception as error:  # a damaged file raises anything
        fault = " ".join(f"{type(error).__name__} {error}".split())[:80]
    audit.of(end.split(".")[0]).look(None if fault is None else f"{file}: {fault}")


def _as_made(row: Record, end: str, content: bytes, size: int) -> bool:
    """Whether a file has the bytes that its row tells of."""
    if end in DIGESTS:
        return hashlib.sha256(content).hexdigest() == getattr(row, DIGESTS[end])
    return content == texts_of(row, size)[end]


def _picture(content: bytes, size: int) -> str | None:
    with Image.open(io.BytesIO(content)) as picture:
        picture.load()
        return None if picture.size == (size, size) and picture.mode == "RGB" else f"{picture.mode} {picture.size}"


def _mask(content: bytes, size: int) -> str | None:
    with Image.open(io.BytesIO(content)) as picture:
        if picture.size != (size, size):
            return f"size {picture.size}"
        return None if (np.asarray(picture.convert("L")) > 127).any() else "empty"


def _features(content: bytes) -> str | None:
    with Image.open(io.BytesIO(content)) as picture:
        picture.load()
        width, height = picture.size
        return None if width == TILES * height else f"size {picture.size}"


def _keypoints(content: bytes, names: tuple[str, ...] | None) -> str | None:
    points = json.loads(content)["keypoints"]
    if names is None:
        return f"no {KEYPOINT_NAMES} names them"
    return None if len(points) == len(names) else f"{len(points)} keypoints for {len(names)} names"


def _check_leaks(found_set: FinishedSet, settings: Settings, audit: Audit) -> None:
    """Nothing may be in two of training, validation and test: no cluster, no file, no near duplicate."""
    splits: dict[str, set[str]] = defaultdict(set)
    contents: dict[str, set[str]] = defaultdict(set)
    hashes: dict[int, set[str]] = defaultdict(set)
    for row in found_set.rows():
        split = TRAIN if row.split == BACK else str(row.split)
        splits[cluster_of(row)].add(split)
        contents[row.sha256 or row.id].add(split)
        if row.phash is not None:
            hashes[int(row.phash, 16)].add(split)
    for cluster, found in splits.items():
        audit.of("one split each").look(f"{cluster} in {', '.join(sorted(found))}" if len(found) > 1 else None)
    for digest, found in contents.items():
        audit.of("no duplicates").look(f"{digest[:16]} in {', '.join(sorted(found))}" if len(found) > 1 else None)
    values = np.array(sorted(hashes), np.uint64)
    for value in values:
        found = hashes[int(value)]
        audit.of("no near duplicates").look(f"{value:016x} in {', '.join(sorted(found))}" if len(found) > 1 else None)
    for first, second in near_pairs(values, settings.duplicates.near_bits)[0]:
        found = hashes[int(values[first])] | hashes[int(values[second])]
        audit.of("no near duplicates").look(
            f"{values[first]:016x} and {values[second]:016x} in {', '.join(sorted(found))}" if len(found) > 1 else None
        )
