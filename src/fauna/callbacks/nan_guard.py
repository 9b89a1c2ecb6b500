"""Non-finite losses: the step is skipped by the LightningModule; here it is counted, named and, if it persists, ended."""

import logging
from collections.abc import Sequence
from typing import Any

from lightning import Callback, LightningModule, Trainer

from fauna.errors import FaunaError
from fauna.system import FaunaSystem
from fauna.types import Batch

log = logging.getLogger(__name__)


class NanGuard(Callback):
    """Counts skipped steps and stops when too many follow each other.

    Args:
        patience: so many skipped steps in a row end the training.
    """

    def __init__(self, *, patience: int) -> None:
        self.patience = patience
        self.total = 0
        self.in_a_row = 0

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Sequence[Batch], batch_idx: int
    ) -> None:
        """Look at what the step reported.

        Raises:
            FaunaError: after ``patience`` skipped steps in a row, naming the photos of the last one.
        """
        assert isinstance(pl_module, FaunaSystem)
        if pl_module.last_finite:
            self.in_a_row = 0
            return
        self.total += 1
        self.in_a_row += 1
        names = ", ".join(name for micro in batch for name in micro.names)
        log.warning("step %d had a non-finite loss and was skipped; photos: %s", trainer.global_step - 1, names)
        if self.in_a_row >= self.patience:
            raise FaunaError(
                f"the loss must be finite, got {self.in_a_row} non-finite steps in a row (photos: {names}); "
                "look at these photos, or lower optimizer.lr and resume from the last checkpoint"
            )

    def state_dict(self) -> dict[str, Any]:
        """Counts survive a resume."""
        return {"total": self.total, "in_a_row": self.in_a_row}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restore the counts."""
        self.total, self.in_a_row = state_dict["total"], state_dict["in_a_row"]
