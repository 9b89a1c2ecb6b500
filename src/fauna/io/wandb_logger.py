"""Weights & Biases without network and without questions."""

from typing import Any

from lightning.pytorch.loggers import WandbLogger


class OfflineWandbLogger(WandbLogger):
    """A logger whose run is closed with the training, so that every job of a sweep gets its own."""

    def finalize(self, status: str) -> None:
        """Close the run."""
        super().finalize(status)
        if self._experiment is not None:
            self._experiment.finish(exit_code=0 if status == "success" else 1)
            self._experiment = None


def offline_wandb(*, project: str, name: str, save_dir: str) -> Any:
    """A logger that only writes files below ``save_dir``; ``wandb sync`` uploads them later.

    Args:
        project: of the run.
        name: of the run.
        save_dir: the run's folder.
    """
    import wandb

    settings = wandb.Settings(silent=True, console="off")
    return OfflineWandbLogger(project=project, name=name, save_dir=save_dir, offline=True, settings=settings)
