"""Batches prepared beside the training thread."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from fauna.threads import in_background
from fauna.types import Batch


@dataclass(frozen=True)
class PreparedBatches:
    """Iterates over numbers from ``start()`` to ``stop`` and makes the batches of each before they are asked for.

    Which batches come does not depend on ``workers`` and ``ahead``: they are a pure function of their number.

    Attributes:
        make: the micro-batches of a step, or the photo of a validation.
        start: the first number; asked when iteration begins, i.e. after a checkpoint was restored.
        stop: the number after the last.
        workers: threads that prepare.
        ahead: how many are prepared in advance; 0 makes each in the calling thread.
    """

    make: Callable[[int], list[Batch]]
    start: Callable[[], int]
    stop: int
    workers: int
    ahead: int

    def __iter__(self) -> Iterator[list[Batch]]:
        return in_background(self.make, range(self.start(), self.stop), workers=self.workers, ahead=self.ahead)

    def __len__(self) -> int:
        """As if iteration began at 0: Lightning counts the steps before a resume too."""
        return self.stop
