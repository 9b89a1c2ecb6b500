"""Pictures of what the model has learned so far."""

from pathlib import Path
from typing import Any

from lightning import Callback, LightningModule, Trainer

from fauna.io.contact_sheet import contact_sheet, save_png
from fauna.stages import Schedule
from fauna.system import FaunaSystem
from fauna.types import Batch


class RenderPreview(Callback):
    """Writes ``pictures/step-<step>.png``: before training, before every stage boundary, every few steps, at the end.

    The photos are the same each time: the data module's ``preview_photos``, validation photos chosen by the seed.

    Args:
        folder: of the run.
        schedule: whose boundaries end with a picture of the stage they close.
        every_steps: steps between two pictures.
        num_photos: rows of a sheet.
        cell: side of one picture, pixels.
        min_steps: a run shorter than this writes none.
    """

    def __init__(
        self, *, folder: str, schedule: Schedule, every_steps: int, num_photos: int, cell: int, min_steps: int
    ) -> None:
        self.folder = Path(folder)
        self.schedule = schedule
        self.every_steps = every_steps
        self.num_photos = num_photos
        self.cell = cell
        self.min_steps = min_steps
        self._photos: list[Batch] = []

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """The untrained model, once."""
        if trainer.global_step == 0 and trainer.max_steps >= self.min_steps:
            assert isinstance(pl_module, FaunaSystem)
            pl_module.set_stage(self.schedule.at(0))
            self._write(trainer, pl_module)

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Write when it is time."""
        step = trainer.global_step
        due = step % self.every_steps == 0 or step == trainer.max_steps or step in self.schedule.boundaries()
        if due and trainer.max_steps >= self.min_steps:
            self._write(trainer, pl_module)

    def _write(self, trainer: Trainer, pl_module: LightningModule) -> None:
        if not trainer.is_global_zero:
            return
        assert isinstance(pl_module, FaunaSystem)
        if not self._photos:
            self._photos = trainer.datamodule.preview_photos(self.num_photos)  # type: ignore[attr-defined]
        sheet = contact_sheet(pl_module.model, self._photos, self.cell)
        save_png(sheet, self.folder / "pictures" / f"step-{trainer.global_step:07d}.png")
