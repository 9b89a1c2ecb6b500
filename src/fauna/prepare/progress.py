"""How far a stage is, on stderr: a live line on a terminal, a line a minute elsewhere."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

LIVE_SECONDS, PLAIN_SECONDS = 0.2, 60.0


class Progress:
    """Counts photographs; silent where nothing takes long.

    Args:
        stage: named in the line.
    """

    def __init__(self, *, stage: str) -> None:
        self.stage = stage
        self.count = 0
        self.live = sys.stderr.isatty()
        self.start = self.last = time.monotonic()

    def __call__(self) -> None:
        """One more."""
        self.count += 1
        now = time.monotonic()
        if now - self.last > (LIVE_SECONDS if self.live else PLAIN_SECONDS):
            self.last = now
            rate = self.count / (now - self.start)
            end = "\r" if self.live else "\n"
            print(
                f"{self.stage}: {self.count:,} photographs, {rate:,.1f} a second ", end=end, file=sys.stderr, flush=True
            )

    def close(self) -> None:
        """Take the live line away."""
        if self.live and self.last > self.start:
            print(" " * 79, end="\r", file=sys.stderr, flush=True)


@contextmanager
def progress(stage: str) -> Iterator[Progress]:
    """A counter for the time of a block."""
    counter = Progress(stage=stage)
    try:
        yield counter
    finally:
        counter.close()
