"""One line of progress every few seconds: step, speed, time left, the main losses."""

import time
from typing import Any

from lightning import Callback, LightningModule, Trainer
from rich.console import Console

from fauna.system import FaunaSystem


class ProgressLine(Callback):
    """Prints plain lines, so that logs of unattended runs stay readable.

    Args:
        every_seconds: time between two lines.
    """

    def __init__(self, *, every_seconds: float) -> None:
        self.every_seconds = every_seconds
        self.console = Console(highlight=False, soft_wrap=True)
        self._last = (0.0, 0)

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Start the clock."""
        self._last = (time.monotonic(), trainer.global_step)

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Print when it is time, and at the last step."""
        now, (then, step) = time.monotonic(), self._last
        if now - then < self.every_seconds and trainer.global_step != trainer.max_steps:
            return
        speed = (trainer.global_step - step) / max(now - then, 1e-9)
        self._last = (now, trainer.global_step)
        if not trainer.is_global_zero or speed == 0:
            return
        left = (trainer.max_steps - trainer.global_step) / speed
        assert isinstance(pl_module, FaunaSystem)
        shown = {k.removeprefix("loss/"): float(v) for k, v in pl_module.latest.items() if k.startswith("loss/")}
        losses = "  ".join(f"{name} {value:.4g}" for name, value in shown.items())
        self.console.print(
            f"step {trainer.global_step}/{trainer.max_steps}  {speed:.2f} it/s  {_duration(left)} left  {losses}"
        )


def _duration(seconds: float) -> str:
    """Hours, minutes and seconds.

    >>> _duration(3725.0)
    '1:02:05'
    """
    whole = int(seconds)
    return f"{whole // 3600}:{whole % 3600 // 60:02d}:{whole % 60:02d}"
