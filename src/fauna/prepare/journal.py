"""Which photographs of a shard are done: a line each, written when everything they need is on the disk.

A killed run leaves at most one torn line at the end, which the next run cuts off. Lines of a photograph that was done again come later
and win.
"""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from fauna.errors import FaunaError
from fauna.prepare.locks import lock
from fauna.prepare.record import Record, Rows


class Journal:
    """The lines of one shard and stage, open for appending, by one process at a time.

    Memory is some 200 bytes a photograph: its key and where its line begins.

    Args:
        path: of the file, made if missing.

    Raises:
        FaunaError: when another process writes it.
    """

    def __init__(self, *, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path = path
        self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        if not lock(self._file, wait=False):
            os.close(self._file)
            raise FaunaError(
                f"{path}: expected one run for a shard, got another that is writing it; wait for it or choose another work folder"
            )
        self._lines: dict[str, tuple[str, int]] = {}
        self._end = self._read()

    def __enter__(self) -> "Journal":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._file)

    def done(self, photo: str, key: str) -> Rows | None:
        """The rows of a photograph that was done with this key, ``None`` otherwise."""
        known = self._lines.get(photo)
        return None if known is None or known[0] != key else self._rows(known[1])

    def commit(self, photo: str, key: str, rows: Rows) -> None:
        """Append a photograph; what was committed survives whatever ends the program.

        Raises:
            OSError: on a full disk; the file then ends where it ended before.
        """
        body = ",".join(row.as_json() for row in rows)
        line = f'{{"photo":"{photo}","key":"{key}","rows":[{body}]}}\n'.encode()
        try:
            written = os.pwrite(self._file, line, self._end)
            if written < len(line):
                raise OSError(28, "No space left on device", str(self.path))
        except OSError:
            os.ftruncate(self._file, self._end)
            raise
        self._lines[photo] = (key, self._end)
        self._end += len(line)

    def rows(self, photos: set[str]) -> Iterator[Record]:
        """All rows of some photographs, by id."""
        for photo in sorted(photos):
            yield from self._rows(self._lines[photo][1])

    def _read(self) -> int:
        """Index the lines and cut a torn one off; where the next line goes."""
        end = 0
        with os.fdopen(os.dup(self._file), "rb") as file:
            file.seek(0)
            for line in file:
                try:
                    entry = json.loads(line) if line.endswith(b"\n") else None
                    photo, key = entry["photo"], entry["key"]  # type: ignore[index]
                except (ValueError, TypeError, KeyError):
                    break
                self._lines[photo] = (key, end)
                end += len(line)
        os.ftruncate(self._file, end)
        return end

    def _rows(self, start: int) -> Rows:
        chunk, line = 4096, b""
        while b"\n" not in line:
            line += os.pread(self._file, chunk, start + len(line))
        entry = json.loads(line[: line.index(b"\n")])
        return tuple(Record.from_values(each) for each in entry["rows"])
