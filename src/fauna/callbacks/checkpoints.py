"""Checkpoints every few steps and minutes, and the final weight file."""

import os
import time
from pathlib import Path
from typing import Any

from lightning import Callback, LightningModule, Trainer

from fauna.io.checkpoint import checkpoints, save_weights
from fauna.io.environment import environment
from fauna.system import FaunaSystem


class Checkpoints(Callback):
    """Writes ``checkpoints/step-<step>.ckpt`` and, at the end, ``weights.safetensors``.

    Args:
        folder: of the run.
        config: the composed configuration as YAML; stored in both.
        every_steps: steps between two checkpoints.
        every_minutes: a checkpoint is also written when so much time has passed.
        keep: so many of the newest are kept.
        half: weight file in fp16.
    """

    def __init__(
        self, *, folder: str, config: str, every_steps: int, every_minutes: float, keep: int, half: bool
    ) -> None:
        self.folder = Path(folder)
        self.config = config
        self.every_steps = every_steps
        self.every_minutes = every_minutes
        self.keep = keep
        self.half = half
        self._last = time.monotonic()

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Start the clock."""
        self._last = time.monotonic()

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Write when it is time."""
        late = time.monotonic() - self._last > 60 * self.every_minutes
        late = trainer.strategy.broadcast(late)
        if late or trainer.global_step % self.every_steps == 0 or trainer.global_step == trainer.max_steps:
            self._write(trainer)

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Export the weights."""
        assert isinstance(pl_module, FaunaSystem)
        if trainer.is_global_zero:
            species = trainer.datamodule.train_species  # type: ignore[attr-defined]
            path = self.folder / "weights.safetensors"
            save_weights(pl_module.model, path, config=self.config, species=species, half=self.half)

    def on_save_checkpoint(self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]) -> None:
        """What a resume compares and a bare checkpoint needs to be rebuilt."""
        assert isinstance(pl_module, FaunaSystem)
        checkpoint["fauna"] = {
            "config": self.config,
            "encoder": pl_module.model.encoder.fingerprint,
            "species": trainer.datamodule.train_species,  # type: ignore[attr-defined]
            "photos": trainer.datamodule.photos_digest(),  # type: ignore[attr-defined]
            "environment": environment(),
        }

    def _write(self, trainer: Trainer) -> None:
        folder = self.folder / "checkpoints"
        folder.mkdir(parents=True, exist_ok=True)
        save_checkpoint(trainer, folder / f"step-{trainer.global_step:07d}.ckpt")
        if trainer.is_global_zero:
            for old in checkpoints(folder)[self.keep :]:
                old.unlink()
        self._last = time.monotonic()


def save_checkpoint(trainer: Trainer, path: Path) -> None:
    """Write a Lightning checkpoint so that ``path`` is either absent, the old file or the complete new one."""
    partial = path.with_suffix(".partial")
    trainer.save_checkpoint(partial)
    if trainer.is_global_zero:
        with partial.open("rb") as handle:
            os.fsync(handle.fileno())
        os.replace(partial, path)
