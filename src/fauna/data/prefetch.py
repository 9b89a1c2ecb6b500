"""Batches prepared beside the training thread."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import torch
from torch import Tensor

from fauna.threads import in_background
from fauna.types import Batch, Features


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
        return in_background(self._ready, range(self.start(), self.stop), workers=self.workers, ahead=self.ahead)

    def _ready(self, number: int) -> list[Batch]:
        batches = self.make(number)
        return [pinned(batch) for batch in batches] if torch.cuda.is_available() else batches

    def __len__(self) -> int:
        """As if iteration began at 0: Lightning counts the steps before a resume too."""
        return self.stop


def pinned(batch: Batch) -> Batch:
    """The same in page-locked memory, from which a GPU copies while both processors go on working."""
    values: dict[str, Any] = {field.name: getattr(batch, field.name) for field in fields(batch)}
    moved = {name: value.pin_memory() for name, value in values.items() if isinstance(value, Tensor)}
    features = batch.features
    if features is not None:
        tokens = features.tokens.pin_memory()
        keys = tokens if features.keys is features.tokens else features.keys.pin_memory()
        features = Features(features.global_.pin_memory(), tokens, keys)
    return replace(batch, **moved, features=features)
