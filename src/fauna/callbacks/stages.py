"""Time enters the model here: stage switches and the discriminator window, pure functions of the step."""

from typing import Any

from lightning import Callback, LightningModule, Trainer

from fauna.stages import Schedule
from fauna.system import FaunaSystem


class StageScheduler(Callback):
    """Sets the model's stage and learning rates before every step.

    Args:
        schedule: step -> stage.
    """

    def __init__(self, *, schedule: Schedule) -> None:
        self.schedule = schedule

    def on_train_batch_start(self, trainer: Trainer, pl_module: LightningModule, batch: Any, batch_idx: int) -> None:
        """Apply the stage of this step."""
        assert isinstance(pl_module, FaunaSystem)
        pl_module.set_stage(self.schedule.at(trainer.global_step))


class DiscriminatorWindow(Callback):
    """Switches the adversarial game on inside its window and freezes the discriminator outside.

    Args:
        schedule: step -> stage.
    """

    def __init__(self, *, schedule: Schedule) -> None:
        self.schedule = schedule

    def on_train_batch_start(self, trainer: Trainer, pl_module: LightningModule, batch: Any, batch_idx: int) -> None:
        """Open or close the window for this step."""
        assert isinstance(pl_module, FaunaSystem)
        active = self.schedule.at(trainer.global_step).adversarial
        pl_module.adversarial = active
        pl_module.adversary.requires_grad_(active)
