"""How long each part of an evaluation took, over all the runs that it was done in."""

import contextlib
import json
import time
from collections.abc import Iterator
from pathlib import Path

from fauna.io.run_folder import write_json

STORE_SECONDS = 10.0
"""What a killed run may lose."""


class Stopwatch:
    """Seconds by part, kept in a file.

    Args:
        path: JSON file; what an interrupted run left there is added to. One that cannot be read counts as empty.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.seconds: dict[str, float] = {}
        with contextlib.suppress(OSError, ValueError, AttributeError, TypeError):
            found = json.loads(path.read_text(encoding="utf-8"))
            self.seconds = {str(part): float(seconds) for part, seconds in found.items()}
        self._part: str | None = None
        self._since = self._stored = time.monotonic()

    @contextlib.contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Measure a part; parts do not overlap."""
        self._part, self._since = name, time.monotonic()
        try:
            yield
        finally:
            self._store()
            self._part = None

    def tick(self) -> None:
        """Store what was measured so far, now and then."""
        if time.monotonic() - self._stored > STORE_SECONDS:
            self._store()

    def rounded(self) -> dict[str, float]:
        """For the report."""
        return {name: round(seconds, 2) for name, seconds in self.seconds.items()}

    def _store(self) -> None:
        now = time.monotonic()
        if self._part is not None:
            self.seconds[self._part] = self.seconds.get(self._part, 0.0) + now - self._since
        self._since = self._stored = now
        write_json(self.seconds, self.path)
