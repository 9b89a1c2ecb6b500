"""The audit of a finished set: is everything there that its manifest says, is it sound, and does nothing leak between splits."""

import contextlib
import hashlib
import io
import json
import os
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image
from rich.console import Console
from rich.table import Table

from fauna.data.fauna_folder import IMAGE_NAME, KEYPOINT_NAMES, read_keypoint_names
from fauna.errors import FaunaError
from fauna.prepare.hashes import near_pairs
from fauna.prepare.place import crop_path, files_of, manifest_files
from fauna.prepare.progress import progress
from fauna.prepare.record import Record
from fauna.prepare.settings import Settings
from fauna.prepare.split import BACK, TRAIN, cluster_of
from fauna.prepare.tables import read_columns, read_table

DIGESTS = {"rgb.jpg": "rgb_sha256", "mask.png": "mask_sha256", "feat16.png": "feat_sha256"}
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
        dest: folder of a finished set.
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
        table.add_row(name, f"{found.looked_at:,}", verdict, found.example)
    Console().print(table)
    print(f"check: {'sound' if audit.sound else 'NOT SOUND'}, {dest}", flush=True)
    return audit.sound


def audit_set(dest: Path, settings: Settings) -> Audit:
    """All checks; arguments and errors as for :func:`check_set`."""
    files = manifest_files(dest)
    if not files:
        raise FaunaError(
            f"{dest}: expected a set of fauna-prepare with a manifest.parquet, got none; run fauna-prepare split"
        )
    audit = Audit()
    joint = _joint(files)
    names = read_keypoint_names(dest)
    size = _crop_size(files, joint, dest, usual=settings.crop.size)
    with progress("check") as tick:
        for row in _usable(files):
            for end in files_of(row):
                _check_file(row, end, dest / crop_path(row, end, joint), names, size, audit)
            audit.of("licences", fatal=settings.check.unlicensed == "fail").look(
                f"{row.source}: unknown" if row.licence == "unknown" else None
            )
            tick()
    _check_leaks(files, settings, audit)
    _check_strays(files, joint, dest, audit)
    return audit


def _usable(files: list[Path]) -> Iterator[Record]:
    for file in files:
        yield from (row for row in read_table(file) if row.ok)


def _crop_size(files: list[Path], joint: frozenset[str], dest: Path, *, usual: int) -> int:
    """Side of the first crop that can be opened: all others must have it too; ``usual`` where there is none."""
    for row in _usable(files):
        with contextlib.suppress(Exception), Image.open(dest / crop_path(row, "rgb.jpg", joint)) as picture:
            return picture.size[0]
    return usual


def _joint(files: list[Path]) -> frozenset[str]:
    """Clusters of several animals: these have folders."""
    seen: set[str] = set()
    twice: set[str] = set()
    for file in files:
        for part in read_columns(file, ["photo", "cluster", "status"]):
            for photo, cluster, status in zip(*part.values(), strict=True):
                if status == "ok":
                    name = cluster or photo
                    (twice if name in seen else seen).add(name)
    return frozenset(twice)


def _check_file(row: Record, end: str, path: Path, names: tuple[str, ...] | None, size: int, audit: Audit) -> None:
    try:
        content = path.read_bytes()
    except OSError as error:
        audit.of("files").look(f"{path}: {error.strerror}")
        return
    digest = DIGESTS.get(end)
    changed = digest is not None and hashlib.sha256(content).hexdigest() != getattr(row, digest)
    audit.of("files").look(f"{path}: changed since it was made" if changed else None)
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
    audit.of(end.split(".")[0]).look(None if fault is None else f"{path}: {fault}")


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


def _check_leaks(files: list[Path], settings: Settings, audit: Audit) -> None:
    """Nothing may be in two of training, validation and test: no cluster, no file, no near duplicate."""
    splits: dict[str, set[str]] = defaultdict(set)
    contents: dict[str, set[str]] = defaultdict(set)
    hashes: dict[int, set[str]] = defaultdict(set)
    for row in _usable(files):
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


def _check_strays(files: list[Path], joint: frozenset[str], dest: Path, audit: Audit) -> None:
    """Photographs in the folder that the manifest does not know: they would be trained on."""
    known = {crop_path(row, "rgb.jpg", joint) for row in _usable(files)}
    for folder, _, names in os.walk(dest):
        for name in names:
            path = Path(folder, name).relative_to(dest)
            if IMAGE_NAME.match(name) and len(path.parts) > 1:
                audit.of("no strays").look(None if path.as_posix() in known else f"{path} is not in the manifest")
