"""Lightning's Trainer, set up for runs that are exact functions of seed and step."""

import logging
import warnings
from collections.abc import Sequence
from typing import Any

import torch
from lightning import Callback, Trainer
from lightning.fabric.utilities.exceptions import MisconfigurationException

from fauna.distributed import GradientAverageStrategy
from fauna.errors import FaunaError
from fauna.threads import set_threads


def build_trainer(
    *,
    max_steps: int,
    accelerator: str,
    devices: int | str | Sequence[int],
    num_nodes: int,
    precision: str,
    threads: int | None,
    deterministic: bool,
    val_every: int,
    val_photos: int,
    log_every: int,
    folder: str,
    callbacks: Sequence[Callback],
    logger: Sequence[Any],
) -> Trainer:
    """A Trainer for :class:`fauna.system.FaunaSystem`.

    Args:
        max_steps: optimiser steps in all.
        accelerator: ``cpu``, ``gpu`` or ``auto``.
        devices: number or list of devices per node.
        num_nodes: machines, started by torchrun or Slurm.
        precision: ``32-true``.
        threads: CPU threads of torch and numba, ``None`` = torch's own choice; a resumed run equals an uninterrupted one at equal threads.
        deterministic: refuse operations without a deterministic implementation (warn only on a GPU).
        val_every: steps between two validations.
        val_photos: photos of one validation.
        log_every: steps between two log rows.
        folder: of the run.
        callbacks: Lightning callbacks.
        logger: Lightning loggers.

    Raises:
        FaunaError: when a number is out of range.
    """
    if max_steps < 1:
        raise FaunaError(
            f"trainer.max_steps: expected a whole number >= 1, got {max_steps}; e.g. trainer.max_steps=3000"
        )
    if isinstance(devices, int) and devices < 1:
        raise FaunaError(
            f"trainer.devices: expected a whole number >= 1, auto or a list, got {devices}; e.g. trainer.devices=1"
        )
    if precision != "32-true":
        raise FaunaError(
            f"trainer.precision: expected 32-true, got {precision}; geometry and rendering need float32, mixed precision is "
            "not supported yet"
        )
    if accelerator == "mps":
        raise FaunaError(
            "trainer.accelerator: expected cpu, gpu or auto, got mps, which lacks float64; use trainer.accelerator=cpu"
        )
    if accelerator == "auto" and not torch.cuda.is_available():
        accelerator = "cpu"
    set_threads(threads)
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]  # costs a pass over every new tensor; nothing reads them
    for noise in (
        ".*does not have many workers.*",
        ".*in eval mode at the start of training.*",
        ".*LeafSpec.*",
        ".*dataloader is not resumable.*",
        ".*smaller than the logging interval.*",
    ):
        warnings.filterwarnings("ignore", message=noise)
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    on_gpu = accelerator in ("gpu", "cuda") or (accelerator == "auto" and torch.cuda.is_available())
    try:
        return Trainer(
            max_steps=max_steps,
            accelerator=accelerator,
            devices=devices,  # type: ignore[arg-type]
            num_nodes=num_nodes,
            strategy=_strategy(devices, num_nodes),
            precision=precision,  # type: ignore[arg-type]
            deterministic=("warn" if on_gpu else True) if deterministic else None,
            val_check_interval=val_every,
            check_val_every_n_epoch=None,
            limit_val_batches=val_photos,
            num_sanity_val_steps=0,
            log_every_n_steps=log_every,
            enable_progress_bar=False,
            enable_model_summary=False,
            enable_checkpointing=False,
            use_distributed_sampler=False,
            default_root_dir=folder,
            callbacks=list(callbacks),
            logger=list(logger),
        )
    except (ValueError, RuntimeError, TypeError, ImportError, MisconfigurationException) as error:
        reason = str(error).splitlines()[0]
        raise FaunaError(
            f"trainer: expected settings this machine can run, got {reason}; try trainer.accelerator=cpu"
        ) from error


def _strategy(devices: int | str | Sequence[int], num_nodes: int) -> Any:
    count = len(devices) if isinstance(devices, (list, tuple)) else devices
    single = num_nodes == 1 and count in (1, "1")
    return "auto" if single else GradientAverageStrategy()
