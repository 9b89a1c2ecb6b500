"""Ctrl-C ends the training between two steps."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from lightning import Callback, LightningModule, Trainer


class Interrupt(Callback):
    """Holds an interrupt from the keyboard back until a step or a validation photo is finished.

    Python would raise it wherever the program happens to be, also between the lines of a lock: then the lock fails with an error of
    its own, and what the user sees is a traceback. A second interrupt is not held back.
    """

    def __init__(self) -> None:
        self.asked = False

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Receive interrupts for a while; elsewhere than in the main thread, which alone may, this does nothing."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = signal.signal(signal.SIGINT, self._receive)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Raises KeyboardInterrupt when one was received."""
        self.raise_if_asked()

    def on_validation_batch_end(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """Raises KeyboardInterrupt when one was received."""
        self.raise_if_asked()

    def _receive(self, number: int, frame: FrameType | None) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True

    def raise_if_asked(self) -> None:
        """Raises KeyboardInterrupt when one was received."""
        if self.asked:
            raise KeyboardInterrupt
