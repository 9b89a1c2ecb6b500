"""Looks now and then for parts of the base shape that the sparse extraction overlooks."""

import logging
from collections.abc import Sequence
from typing import Any

import torch
from lightning import Callback, LightningModule, Trainer

from fauna.geometry.sparse_extraction import EmptyMeshError
from fauna.random import Draws
from fauna.system import FaunaSystem
from fauna.types import Batch

log = logging.getLogger(__name__)


class MeshAudit(Callback):
    """Logs ``audit/missed_components`` for the shape of a batch every few steps and warns once when there are any.

    Only reads: the lattice jitter is that of the step again, from a generator of its own, so that a run with the
    callback equals one without it bit for bit.

    Args:
        every_n_steps: steps between two audits.
    """

    def __init__(self, *, every_n_steps: int) -> None:
        self.every_n_steps = every_n_steps
        self.warned = False

    @torch.no_grad()
    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Sequence[Batch], batch_idx: int
    ) -> None:
        """Audit when it is time, on the first process."""
        assert isinstance(pl_module, FaunaSystem)
        step = trainer.global_step - 1
        if (step + 1) % self.every_n_steps or not trainer.is_global_zero:
            return
        model, micro = pl_module.model, batch[0]
        features = model.feature_space.normalize(model.encode(micro))
        code = model.bank(features.global_, micro.category).embedding.mean(dim=0)
        try:
            missed = model.shape.audit(code, Draws(pl_module.seed, step).generator("lattice_jitter"))
        except EmptyMeshError:  # the next step reports it like a non-finite loss
            return
        for logger in trainer.loggers:
            logger.log_metrics({"audit/missed_components": float(missed)}, step)
        if missed > 0 and not self.warned:
            self.warned = True
            log.warning(
                "step %d: the extraction overlooked %d components of the base shape; raise shape.lipschitz or "
                "schedule.weights.eikonal and see audit/missed_components",
                step,
                missed,
            )

    def state_dict(self) -> dict[str, Any]:
        """A resumed run does not warn again."""
        return {"warned": self.warned}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restore whether there was a warning."""
        self.warned = state_dict["warned"]
