"""What ``checkpoint=`` may name, and what of it goes into the protocol."""

import hashlib
import re
from pathlib import Path
from typing import Any

import torch

from fauna.errors import FaunaError
from fauna.io.checkpoint import newest_checkpoint
from fauna.pretrained.shipped import PRETRAINED, shipped_weights


def locate(name: str) -> Path:
    """The file behind ``pretrained``, a weight file, a checkpoint or the folder of a run.

    A run's ``weights.safetensors`` is preferred; a run that has not ended yet has checkpoints only.

    Raises:
        FaunaError: when there is none.
    """
    if name == PRETRAINED:
        return shipped_weights()
    path = Path(name).expanduser()
    if not path.is_dir():
        if not path.is_file():
            raise FaunaError(
                f"checkpoint: expected a weight file, a checkpoint or a run folder, got {name}, which does not exist; "
                "check the path"
            )
        return path
    if (path / "weights.safetensors").is_file():
        return path / "weights.safetensors"
    found = newest_checkpoint(path / "checkpoints" if (path / "checkpoints").is_dir() else path)
    if found is None:
        raise FaunaError(
            f"checkpoint: expected a run folder with weights.safetensors or checkpoints, got {path} without any; "
            "check the path"
        )
    return found


def facts(path: Path, metadata: dict[str, Any]) -> dict[str, Any]:
    """Identity of a weight file for the protocol.

    Args:
        path: of :func:`locate`.
        metadata: of :func:`fauna.io.checkpoint.read_weights`.
    """
    config = metadata["config"]
    return {
        "file": path.name,
        "run": config.get("name"),
        "sha256": file_digest(path),
        "step": _step(path),
        "encoder": metadata["encoder"],
        "species": metadata["species"],
        "trained_on": config["data"]["source"],
        "training_seed": config["seed"],
        "config": config,
    }


def file_digest(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    with path.open("rb") as handle:
        digest = hashlib.sha256()
        while block := handle.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _step(path: Path) -> int | None:
    """Training step: of a checkpoint its own, of a weight file that of the run's last checkpoint beside it."""
    if path.suffix == ".ckpt":
        return int(torch.load(path, map_location="cpu", weights_only=True, mmap=True)["global_step"])
    steps = [int(match[1]) for file in (path.parent / "checkpoints").glob("*.ckpt") if (match := _name(file.name))]
    return max(steps, default=None)


def _name(name: str) -> re.Match[str] | None:
    return re.fullmatch(r"step-(\d+)\.ckpt", name)
