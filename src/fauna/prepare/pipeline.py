"""The stages in their order, and what each needs before it can begin.

Steps work on shards and know nothing of each other. Between some of them lies a stage that has to see all shards together (``duplicates``,
``basis``, ``split``); it is done by whoever comes first, once, while others wait.
"""

import hashlib
import heapq
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fauna.errors import FaunaError
from fauna.prepare.driver import Tally, photos_of, run_step
from fauna.prepare.duplicates import find_duplicates, judged, photographs
from fauna.prepare.locks import one_at_a_time
from fauna.prepare.overrides import expect_known, read_names, read_overrides
from fauna.prepare.record import Record, Rows
from fauna.prepare.settings import Settings, digest
from fauna.prepare.shard import Shard, parse_shard
from fauna.prepare.sources.base import Source
from fauna.prepare.split import Members, Split, assigned, choose_split
from fauna.prepare.steps import build_step
from fauna.prepare.tables import ROWS_AT_ONCE, read_columns, read_table, write_table
from fauna.prepare.workspace import Workspace, write_file
from fauna.threads import set_threads

BEFORE = {"duplicates": "scan", "mask": "duplicates", "crop": "mask", "filter": "crop", "features": "filter"}
"""The stage whose tables a stage reads."""

COMMAND_OF = {"duplicates": "scan", "basis": "features"}
"""The command that makes the tables of a stage, where it has another name."""

MOST_OPEN = 128
"""Tables that are read side by side."""

KEYPOINT_NAMES = "keypoint_names.json"


@dataclass(frozen=True)
class Pipeline:
    """The stages of a set.

    Attributes:
        settings: of the command.
        workspace: the folders.
        tick: called after every photograph.
    """

    settings: Settings
    workspace: Workspace
    tick: Callable[[], None] = lambda: None

    @property
    def count(self) -> int:
        """Number of shards: of the first command that ran in the work folder.

        Raises:
            FaunaError: when this command says another number.
        """
        path = self.workspace.work / "shards.txt"
        asked = None if self.settings.shard is None else parse_shard(self.settings.shard).count
        if not path.is_file():
            write_file(path, f"{asked or self.settings.shards}\n".encode())
        known = int(path.read_text(encoding="utf-8"))
        if asked not in (None, known) or (asked is None and self.settings.shards not in (1, known)):
            raise FaunaError(
                f"shard: expected one of {known} shards, as {self.workspace.work} was begun, got {asked or self.settings.shards}; "
                "use that number or another work folder"
            )
        return known

    def shards(self) -> list[Shard]:
        """Those that this command works on."""
        count = self.count
        if self.settings.shard is not None:
            return [parse_shard(self.settings.shard)]
        return [Shard(index, count) for index in range(count)]

    def tables(self, stage: str) -> list[Path]:
        """The tables of a stage, of all shards."""
        return [self.workspace.table(stage, Shard(index, self.count)) for index in range(self.count)]

    def last(self) -> str:
        """The stage whose tables are split: the last that works on photographs."""
        return "features" if self.settings.features.encoder is not None else "filter"

    def run(self, name: str, shard: Shard) -> Tally:
        """Bring a shard through a step.

        Args:
            name: of :data:`fauna.prepare.steps.IMAGE_STEPS`.
            shard: the shard.

        Raises:
            FaunaError: when the step before it has not been run.
        """
        if name == "scan":
            self._back_views()  # a list that is missing is told before the work
            source = self._source()
            photos: Iterator[Rows] = (rows for rows in source.photos() if rows[0].group in shard)
        else:
            before = BEFORE[name]
            if before == "duplicates":
                self.duplicates()
            if name == "features":
                self.basis()
            self._expect(before, [self.workspace.table(before, shard)])
            photos = photos_of(self.workspace.table(before, shard))
            set_threads(1)  # sums on one thread have one order: the same bytes wherever a photograph is worked on
        return run_step(build_step(name, self.settings, self.workspace), photos, self.workspace, shard, self.tick)

    def duplicates(self) -> None:
        """Compare the photographs of all shards; done again when a table of ``scan`` or a distance changed."""
        scans = self.tables("scan")
        self._expect("scan", scans)
        with self._once("duplicates", digest(1, self.settings.duplicates), scans) as needed:
            if needed:
                verdicts = find_duplicates(photographs(scans), self.settings.duplicates)
                for scan, table in zip(scans, self.tables("duplicates"), strict=True):
                    write_table(table, judged(photos_of(scan), verdicts))

    def basis(self) -> None:
        """Fit the basis of the feature maps to all shards."""
        tables = self.tables("filter")
        self._expect("filter", tables)
        with self._once("basis", digest(1, self.settings.features), tables) as needed:
            if needed:
                from fauna.prepare.basis import fit_basis

                fit_basis(tables, self.settings, self.workspace)

    def split(self) -> Split:
        """Choose the split of all shards; writes the tables of the stage ``split``."""
        before = self.tables(self.last())
        self._expect(self.last(), before)
        members = Members()
        for table in before:
            for part in read_columns(table, ["species", "cluster", "photo", "status"]):
                for species, cluster, photo, status in zip(*part.values(), strict=True):
                    if status == "ok":
                        members.add(species, cluster or photo)
        split = choose_split(members, self.settings.split)
        self.expect_known(self.last())
        back_views = self._back_views()
        for table, new in zip(before, self.tables("split"), strict=True):
            write_table(new, assigned(read_table(table), split, back_views))
        return split

    def expect_known(self, stage: str) -> None:
        """Refuse lists of a user that name what the tables of a stage do not have."""
        path = self.settings.overrides
        verdicts = read_overrides(None if path is None else Path(path)).verdicts
        expect_known({"overrides": verdicts, "split.back_views": self._back_views()}, self.tables(stage))

    def _back_views(self) -> frozenset[str]:
        path = self.settings.split.back_views
        return read_names(None if path is None else Path(path), "split.back_views")

    def rows(self, stage: str) -> Iterator[Record]:
        """The rows of all shards, one shard after the other."""
        for table in self.tables(stage):
            yield from read_table(table)

    def merged(self, stage: str) -> Iterator[Record]:
        """The rows of all shards, by photo and instance, whatever the number of shards.

        Many shards are first merged to fewer tables, because every open table is a file and a row group in memory.
        """
        tables, level = self.tables(stage), 0
        while len(tables) > MOST_OPEN:
            folder = self.workspace.work / "tables" / f"{stage}-merged-{level}"
            groups = [tables[start : start + MOST_OPEN] for start in range(0, len(tables), MOST_OPEN)]
            tables = [folder / f"{number:05d}.parquet" for number in range(len(groups))]
            for group, table in zip(groups, tables, strict=True):
                write_table(table, _side_by_side(group))
            level += 1
        return _side_by_side(tables)

    def keypoint_names(self) -> tuple[str, ...] | None:
        """Of the source, as the scan found them."""
        path = self.workspace.work / KEYPOINT_NAMES
        if not path.is_file():
            return None
        names = json.loads(path.read_text(encoding="utf-8"))
        return None if names is None else tuple(names)

    def _source(self) -> Source:
        from fauna.prepare.sources.detect import open_source

        source = open_source(self.settings, self.workspace)
        names = json.dumps(source.keypoint_names)
        write_file(self.workspace.work / KEYPOINT_NAMES, f"{names}\n".encode())
        return source

    def _expect(self, stage: str, tables: Sequence[Path]) -> None:
        missing = [table.stem for table in tables if not table.is_file()]
        if missing:
            command = COMMAND_OF.get(stage, stage)
            raise FaunaError(
                f"{self.workspace.work}: expected the tables of fauna-prepare {command}, got none of {', '.join(missing[:5])}"
                f"{', ...' if len(missing) > 5 else ''}; run fauna-prepare {command} for these shards first"
            )

    @contextmanager
    def _once(self, stage: str, key: str, tables: Sequence[Path]) -> Iterator[bool]:
        """Whether a stage that sees all shards has to be done; others wait meanwhile."""
        folder = self.workspace.work / "stages"
        made = key + "".join(f"\n{hashlib.sha256(table.read_bytes()).hexdigest()}" for table in tables)
        done = folder / f"{stage}.made_from"
        with one_at_a_time(folder / f"{stage}.lock"):
            needed = not done.is_file() or done.read_text(encoding="utf-8") != made
            if needed:
                done.unlink(missing_ok=True)
            yield needed
            if needed:
                write_file(done, made.encode())


def _side_by_side(tables: Sequence[Path]) -> Iterator[Record]:
    at_once = max(ROWS_AT_ONCE // len(tables), 16)
    return heapq.merge(*(read_table(table, at_once) for table in tables), key=_order)


def _order(row: Record) -> tuple[str, int]:
    return row.photo, row.instance
