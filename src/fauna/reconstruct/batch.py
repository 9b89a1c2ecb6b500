"""Many photographs, one after the other: skipped when done, written whole, told in one line each."""

import os
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

import fauna
from fauna.errors import FaunaError
from fauna.evaluation.weights import file_digest, locate
from fauna.pretrained.shipped import PRETRAINED
from fauna.reconstruct.folders import KEY, Job, finished, is_free, job_key, read_result, whole_folder
from fauna.reconstruct.mask_files import masks_beside
from fauna.reconstruct.outputs import write
from fauna.reconstruct.reconstructor import Reconstructor
from fauna.reconstruct.result import InputFacts, Result
from fauna.reconstruct.settings import Settings
from fauna.threads import set_threads

Item = TypeVar("Item")
Line = tuple[str, str, str]
"""Name, status and reason of an animal."""

SHOW_FROM = 2
"""Photographs from which a progress bar is worth its line."""


class Loader:
    """Loads the model when the first photograph needs it: not at all when everything is done.

    Args:
        checkpoint: as for :func:`fauna.load`.
        device: likewise.
        settings: likewise.

    Raises:
        FaunaError: when there is no such weight file.
    """

    def __init__(self, checkpoint: str | None, device: str, settings: Settings) -> None:
        self.checkpoint, self.device, self.settings = checkpoint, device, settings
        self.sha256 = file_digest(locate(PRETRAINED if checkpoint is None else checkpoint))
        self._loaded: Reconstructor | None = None

    def facts(self) -> dict[str, Any]:
        """What decides, besides photographs and masks, what comes out."""
        return {"settings": self.settings.as_dict(), "weights": self.sha256, "fauna": fauna.__version__}

    def get(self) -> Reconstructor:
        """The model, loaded once."""
        if self._loaded is None:
            from fauna.reconstruct.load import load

            self._loaded = load(self.checkpoint, device=self.device, settings=self.settings)
        return self._loaded


def run_jobs(
    jobs: Sequence[Job],
    out: Path,
    settings: Settings,
    *,
    checkpoint: str | None,
    device: str,
    masks: Sequence[Path] | None,
    overwrite: bool,
    threads: int,
) -> list[str]:
    """Reconstruct photographs into ``out/<name>/``.

    Args:
        jobs: photographs with their names.
        out: made if missing.
        settings: numbers and choices.
        checkpoint: weight file, ``None`` for the shipped model.
        device: where the model goes.
        masks: of the only photograph, ``None`` to find them.
        overwrite: replace results of other options.
        threads: of the CPU.

    Returns:
        The status of every animal.

    Raises:
        FaunaError: when the model cannot be had, or ``out`` cannot be written.
    """
    set_threads(threads)
    loader = Loader(checkpoint, device, settings)
    out.mkdir(parents=True, exist_ok=True)
    return work_through(jobs, lambda job: run_job(job, out, loader, masks=masks, overwrite=overwrite), "photographs")


def work_through(items: Sequence[Item], work: Callable[[Item], list[Line]], what: str) -> list[str]:
    """Do one after the other, with a line for each animal and a progress bar where there are several.

    Args:
        items: what there is to do.
        work: does it.
        what: the items are, in the plural.

    Returns:
        The status of every animal.
    """
    console = Console(highlight=False, soft_wrap=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    told: list[str] = []
    with Progress(*columns, console=console, transient=True, disable=len(items) < SHOW_FROM) as progress:
        task = progress.add_task(what, total=len(items))
        for item in items:
            begun = time.monotonic()
            for name, status, reason in work(item):
                spent = f"{time.monotonic() - begun:.1f} s"
                console.print(f"{name}: {status} ({reason or spent})", markup=False)
                told.append(status)
            progress.advance(task)
    if len(told) > 1:
        console.print(_total(told), markup=False)
    return told


def run_job(job: Job, out: Path, loader: Loader, *, masks: Sequence[Path] | None, overwrite: bool) -> list[Line]:
    """One photograph: name, status and reason of each of its animals."""
    files = list(masks) if masks is not None else masks_beside(job.photo)
    key = job_key(job.photo, files, loader.facts())
    done = finished(out, job, key)
    if done is not None:
        return [(str(each["name"]), str(each["status"]), "done before") for each in done]
    if not is_free(out / job.name, overwrite=overwrite):
        return [taken_line(out, job.name)]
    results = reconstruct_guarded(job, loader, masks)
    names = [job.animal(index) for index in range(len(results))]
    taken = [name for name in names if not is_free(out / name, overwrite=overwrite)]
    if taken:
        return [taken_line(out, name) for name in taken]
    _forget(out, job, names)
    extra: dict[str, Any] = {KEY: key, "animals": names}
    lines = []
    for name, result in reversed(list(zip(names, results, strict=True))):  # the first one says that all are there
        with whole_folder(out / name) as folder:
            told = write_guarded(replace(result, name=name), folder, extra)
        lines.append((name, told.status, told.reason))
    return lines[::-1]


def taken_line(out: Path, name: str) -> Line:
    """What is said of a folder that may not be written."""
    return name, "exists", f"{out / name} holds something else; add --overwrite or choose another --out"


def _forget(out: Path, job: Job, names: Sequence[str]) -> None:
    """Remove further animals that an earlier, now overwritten result of the photograph had."""
    before = read_result(out / job.name) or {}
    for name in set(map(str, before.get("animals", []))) - set(names):
        if Path(name).name == name and is_free(out / name, overwrite=True):
            shutil.rmtree(out / name, ignore_errors=True)


def write_guarded(result: Result, folder: Path, extra: dict[str, Any]) -> Result:
    """Write a result; when a part of it cannot be made, the folder says so instead."""
    try:
        write(result, folder, **extra)
    except (OSError, MemoryError):
        raise  # of the disk, not of the photograph
    except Exception as error:
        result = failed(result, error)
        for each in folder.iterdir():
            each.unlink()
        write(result, folder, **extra)
    return result


def reconstruct_guarded(job: Job, loader: Loader, masks: Sequence[Path] | None) -> list[Result]:
    """The photograph's results; a defect of ours costs one photograph, not the folder of photographs."""
    reconstructor = loader.get()
    try:
        return reconstructor.reconstruct_all(job.photo, masks=masks, name=job.name)
    except Exception as error:
        empty = Result(
            name=job.name,
            status="failed",
            reason="",
            flags=(),
            confidence=0.0,
            source=InputFacts(file=job.photo.name),
            weights=reconstructor.weights,
            settings=reconstructor.settings,
        )
        return [failed(empty, error)]


def failed(result: Result, error: Exception) -> Result:
    """The result without its animal, and why; with ``FAUNA_DEBUG`` the error itself.

    Raises:
        SystemExit: when the error is what compiled code makes of a request to end (as ``KeyboardInterrupt``).
    """
    seen: BaseException | None = error
    while seen is not None:
        if isinstance(seen, SystemExit | KeyboardInterrupt):
            raise seen
        seen = seen.__cause__ or seen.__context__
    if os.environ.get("FAUNA_DEBUG"):
        raise error
    reason = " ".join(f"{type(error).__name__}: {error}".split())[:300] + "; FAUNA_DEBUG=1 shows where"
    if isinstance(error, FaunaError):
        reason = str(error)
    return replace(result, status="failed", reason=reason, fit=None, confidence=0.0)


def _total(told: Sequence[str]) -> str:
    counts = {status: told.count(status) for status in dict.fromkeys(told)}
    return f"{len(told)} animals: " + ", ".join(f"{count} {status}" for status, count in counts.items())
