"""Which photographs, and the folder of each: found, named, claimed, written whole or not at all."""

import contextlib
import glob
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fauna.errors import FaunaError
from fauna.reconstruct.formats import PHOTO_SUFFIXES

RESULT = "result.json"
PARTIAL = ".partial"
KEY = "key"
"""Of ``result.json``: digest of everything that decides what is in the folder."""


@dataclass(frozen=True)
class Job:
    """A photograph to be reconstructed.

    Attributes:
        photo: its file.
        name: of its first animal, and of that one's folder.
        reserved: names that further animals may not take.
    """

    photo: Path
    name: str
    reserved: frozenset[str]

    def animal(self, index: int) -> str:
        """Name of its ``index``-th animal, from 0: ``x``, ``x_2``, ``x_3``, without those that other photographs have."""
        names = (f"{self.name}_{number}" for number in range(2, 10_000))
        free = (name for name in names if name.casefold() not in self.reserved)
        return self.name if index == 0 else next(name for number, name in enumerate(free, start=1) if number == index)


def find_photos(inputs: Sequence[str]) -> list[Path]:
    """Photographs among files, folders (their pictures, not deeper) and patterns, in this order, each once.

    Of folders and patterns, files of other kinds and masks (``*_mask.png``, ``masks/``) are left out. A file that is named is taken
    as it is: what is wrong with it is said in its result.

    Raises:
        FaunaError: when an input matches nothing.
    """
    found: dict[Path, None] = {}
    for text in inputs:
        path = Path(text).expanduser()
        if path.is_file():
            matches = [path]
        elif path.is_dir():
            matches = sorted(each for each in path.iterdir() if _is_photo(each))
        else:
            matches = sorted(each for each in map(Path, glob.glob(str(path), recursive=True)) if _is_photo(each))
        if not matches:
            what = "a folder without any" if path.is_dir() else "nothing there"
            raise FaunaError(
                f"{text}: expected a photograph, a folder of photographs or a pattern, got {what}; check the path"
            )
        found.update(dict.fromkeys(matches))
    return list(found)


def name_jobs(photos: Sequence[Path]) -> list[Job]:
    """A name for each photograph: its stem; the second of a stem is ``<stem>_2``, and so on.

    Dots around a stem are left out: a file ``...jpg`` must not become the folder above.
    """
    own = [photo.stem.strip(". ") or "photo" for photo in photos]
    stems = {stem.casefold() for stem in own}
    taken: set[str] = set()
    names = []
    for stem in own:
        name, number = stem, 1
        while name.casefold() in taken or (number > 1 and name.casefold() in stems):
            number += 1
            name = f"{stem}_{number}"
        taken.add(name.casefold())
        names.append(name)
    return [Job(photo, name, frozenset(taken)) for photo, name in zip(photos, names, strict=True)]


def job_key(photo: Path, masks: Sequence[Path], facts: Mapping[str, Any]) -> str:
    """Digest of a photograph's bytes, its masks' bytes, and the ``facts``; files that cannot be read count as empty."""
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode())
    for path in (photo, *masks):
        digest.update(f"|{path.name}|".encode())
        with contextlib.suppress(OSError), path.open("rb") as handle:
            while block := handle.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def finished(out: Path, job: Job, key: str) -> list[dict[str, Any]] | None:
    """The results of a photograph that was done with the same key, of all its animals; ``None`` when anything is missing."""
    first = read_result(out / job.name)
    if first is None or first.get(KEY) != key:
        return None
    names = [str(name) for name in first.get("animals", [])]
    results = [read_result(out / name) for name in names]
    whole = [
        each
        for name, each in zip(names, results, strict=True)
        if each is not None and each.get(KEY) == key and _is_there(out / name, each)
    ]
    return whole if whole and len(whole) == len(results) else None


def _is_there(folder: Path, result: Mapping[str, Any]) -> bool:
    """Whether every file that a result names still lies in its folder."""
    return all((folder / str(name)).is_file() for name in result.get("files", []))


def read_result(folder: Path) -> dict[str, Any] | None:
    """The ``result.json`` of a folder, ``None`` where there is none that can be read."""
    try:
        content = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) and "schema" in content else None


def is_free(folder: Path, *, overwrite: bool) -> bool:
    """Whether a folder may be written: it does not exist, is empty, or holds a result that is to be overwritten and nothing else."""
    if not folder.exists():
        return True
    if not folder.is_dir():
        return False
    present = {each.name for each in folder.iterdir()}
    return not present or (overwrite and present <= _files(folder))


def _files(folder: Path) -> set[str]:
    """Names of the files that a result wrote into its folder; none where there is no result."""
    found = read_result(folder)
    return set() if found is None else {RESULT, *map(str, found.get("files", []))}


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A temporary folder beside ``folder`` that takes its place when the block ends well, and vanishes otherwise.

    Every process has its own. What killed programs left is removed.
    """
    if folder.name in ("", ".", ".."):
        raise FaunaError(
            f"{folder}: expected the name of a new folder, got one that cannot be replaced; name a folder in it"
        )
    for left in folder.parent.glob(f".{glob.escape(folder.name)}.*{PARTIAL}"):
        if not _runs(left.name.removesuffix(PARTIAL).rpartition(".")[2]):
            shutil.rmtree(left, ignore_errors=True)
    partial = folder.with_name(f".{folder.name}.{os.getpid()}{PARTIAL}")
    partial.mkdir(parents=True)
    try:
        yield partial
        if folder.exists():
            shutil.rmtree(folder)
        partial.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _runs(process: str) -> bool:
    """Whether a process of this machine with that number is alive, other than this one."""
    if not process.isdigit() or int(process) == os.getpid():
        return False
    try:
        os.kill(int(process), 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass  # somebody else's
    return True


def _is_photo(path: Path) -> bool:
    if not path.is_file() or path.suffix.lower() not in PHOTO_SUFFIXES or path.name.startswith("."):
        return False
    return not path.stem.endswith("_mask") and path.parent.name != "masks"
