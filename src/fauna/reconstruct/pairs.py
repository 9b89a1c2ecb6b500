"""Morphs and transferred poses from the command line: skipped when done, written whole, told in one line each."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from fauna.reconstruct.batch import (
    Line,
    Loader,
    failed,
    reconstruct_guarded,
    taken_line,
    work_through,
)
from fauna.reconstruct.folders import KEY, Job, finished, is_free, job_key, name_jobs, whole_folder
from fauna.reconstruct.mask_files import masks_beside
from fauna.reconstruct.pair import Pair
from fauna.reconstruct.result import Result
from fauna.reconstruct.settings import Settings
from fauna.threads import set_threads

Kind = Literal["morph", "pose"]
JOINED: dict[Kind, str] = {"morph": "to", "pose": "posed_as"}
"""Between the two names of a folder."""


@dataclass(frozen=True)
class PairJob:
    """Two photographs and what is to be made of them.

    Attributes:
        kind: ``morph``, or ``pose``: that of the second on the animal of the first.
        first: photograph.
        second: the other.
        masks: of each, ``None`` to find them.
        frames: of a morph; 0 otherwise.
    """

    kind: Kind
    first: Job
    second: Job
    masks: tuple[Path | None, Path | None]
    frames: int

    @property
    def name(self) -> str:
        """Of the folder."""
        return f"{self.first.name}_{JOINED[self.kind]}_{self.second.name}"

    def key(self, loader: Loader) -> str:
        """Digest of everything that decides what comes out."""
        files = [self.second.photo]
        for job, mask in zip((self.first, self.second), self.masks, strict=True):
            files += masks_beside(job.photo) if mask is None else [mask]
        return job_key(self.first.photo, files, {**loader.facts(), "kind": self.kind, "frames": self.frames})


def morph_job(first: Path, second: Path, masks: Sequence[Path], frames: int) -> PairJob:
    """From one photograph to another; ``masks`` are none or two."""
    one, other = name_jobs([first, second])
    return PairJob("morph", one, other, (masks[0], masks[1]) if masks else (None, None), frames)


def pose_jobs(bodies: Sequence[Path], pose: Path, masks: Sequence[Path]) -> list[PairJob]:
    """The pose of one photograph for the animals of others; a mask is that of the only body."""
    jobs = name_jobs([*bodies, pose])
    mask = masks[0] if masks else None
    return [PairJob("pose", each, jobs[-1], (mask, None), 0) for each in jobs[:-1]]


def run_pairs(
    jobs: Sequence[PairJob],
    out: Path,
    settings: Settings,
    *,
    checkpoint: str | None,
    device: str,
    overwrite: bool,
    threads: int,
) -> list[str]:
    """Make morphs or transferred poses into ``out/<name>/``; arguments and result as of :func:`fauna.reconstruct.batch.run_jobs`."""
    set_threads(threads)
    loader = Loader(checkpoint, device, settings)
    out.mkdir(parents=True, exist_ok=True)
    known: dict[Path, Result] = {}  # a pose is asked for once, however many animals take it
    return work_through(jobs, lambda job: _run_pair(job, out, loader, known, overwrite=overwrite), "pairs")


def _run_pair(job: PairJob, out: Path, loader: Loader, known: dict[Path, Result], *, overwrite: bool) -> list[Line]:
    key = job.key(loader)
    whole = Job(job.first.photo, job.name, frozenset())
    done = finished(out, whole, key)
    if done is not None:
        return [(job.name, str(done[0]["status"]), "done before")]
    if not is_free(out / job.name, overwrite=overwrite):
        return [taken_line(out, job.name)]
    first = _result(job.first, job.masks[0], loader, {})
    second = _result(job.second, job.masks[1], loader, known if job.kind == "pose" else {})
    with whole_folder(out / job.name) as folder:
        pair = _write(job, first, second, folder, {KEY: key, "animals": [job.name]})
    return [(job.name, pair.status, pair.reason)]


def _result(job: Job, mask: Path | None, loader: Loader, known: dict[Path, Result]) -> Result:
    """The largest animal of a photograph."""
    if job.photo not in known:
        found = reconstruct_guarded(job, loader, None if mask is None else [mask])[0]
        known[job.photo] = replace(found, name=job.name)
    return known[job.photo]


def _write(job: PairJob, first: Result, second: Result, folder: Path, extra: dict[str, object]) -> Pair:
    """Write a pair; when a part of it cannot be made, the folder says so instead."""
    from fauna.reconstruct.morph import Morph
    from fauna.reconstruct.pair_files import write_morph, write_transfer
    from fauna.reconstruct.posing import PoseTransfer

    def write(one: Result) -> Pair:
        if job.kind == "morph":
            morph = Morph(name=job.name, first=one, second=second, frames=job.frames)
            write_morph(morph, folder, **extra)
            return morph
        transfer = PoseTransfer(job.name, one, second)
        write_transfer(transfer, folder, **extra)
        return transfer

    try:
        return write(first)
    except (OSError, MemoryError):
        raise  # of the disk, not of the photographs
    except Exception as error:
        for each in folder.iterdir():
            each.unlink()
        return write(failed(first, error))
