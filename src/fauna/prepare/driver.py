"""Running a step over the photographs of a shard: what was done before is skipped, every photograph is committed when it is done."""

import hashlib
import itertools
import json
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from fauna.prepare.journal import Journal
from fauna.prepare.record import Record, Rows
from fauna.prepare.shard import Shard
from fauna.prepare.steps import Step
from fauna.prepare.tables import read_table, write_table
from fauna.prepare.workspace import Workspace

Tick = Callable[[], None]


@dataclass(frozen=True)
class Tally:
    """What a run of a step did.

    Attributes:
        photos: of the shard.
        worked: photographs that the step was called for; the others were done before or had no row that is ok.
        seconds: in the step.
    """

    photos: int
    worked: int
    seconds: float


def run_step(step: Step, photos: Iterable[Rows], workspace: Workspace, shard: Shard, tick: Tick) -> Tally:
    """Bring the photographs of a shard through a step and write their table.

    Args:
        step: the step.
        photos: rows of every photograph of the shard.
        workspace: the folders.
        shard: whose journal and table are written.
        tick: called after every photograph.

    Raises:
        FaunaError: when another process works on the shard.
        OSError: when something cannot be written; what was committed stays.
    """
    seen: set[str] = set()
    worked, seconds = 0, 0.0
    with Journal(path=workspace.journal(step.name, shard)) as journal:
        for rows in photos:
            photo = rows[0].photo
            key = unit_key(step, rows)
            done = journal.done(photo, key)
            if done is None or not step.intact(done):
                start = time.perf_counter()
                has_work = any(row.ok for row in rows)
                journal.commit(photo, key, step(rows) if has_work else rows)
                seconds += time.perf_counter() - start
                worked += has_work
            seen.add(photo)
            tick()
        write_table(workspace.table(step.name, shard), journal.rows(seen))
    tally = Tally(len(seen), worked, seconds)
    _log(workspace, step.name, shard, tally)
    return tally


def unit_key(step: Step, rows: Rows) -> str:
    """Digest of everything that decides what a step makes of a photograph: the step's key, its rows, and the files' stamp."""
    text = "\n".join((step.key, step.stamp(rows), *(row.as_json() for row in rows)))
    return hashlib.blake2b(text.encode("utf-8", "surrogateescape"), digest_size=8).hexdigest()


def photos_of(table: Path) -> Iterator[Rows]:
    """The rows of a table, photograph by photograph."""
    for _, rows in itertools.groupby(read_table(table), key=_photo):
        yield tuple(rows)


def _photo(row: Record) -> str:
    return row.photo


def _log(workspace: Workspace, stage: str, shard: Shard, tally: Tally) -> None:
    workspace.logs.mkdir(parents=True, exist_ok=True)
    entry = {"stage": stage, "shard": shard.stem, "photos": tally.photos, "worked": tally.worked}
    entry["seconds"] = round(tally.seconds, 3)
    with (workspace.logs / "timings.jsonl").open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry) + "\n")
