"""The folder of a run: who may write into it, what a resume compares, where weights start from."""

import json
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from omegaconf import OmegaConf

from fauna.errors import FaunaError
from fauna.io.checkpoint import checkpoints, newest_checkpoint
from fauna.io.environment import environment

log = logging.getLogger(__name__)

FREE_TO_CHANGE = (
    "resume",
    "out",
    "name",
    "logger",
    "callbacks",
    "trainer.max_steps",
    "trainer.log_every",
    "trainer.val_every",
    "data.prefetch",
    "data.fill_workers",
    "data.memory_megabytes",
)
"""Keys that may differ between a run and its continuation without changing what is learned."""


def resume_path(resume: str | None, folder: Path) -> Path | None:
    """The checkpoint to continue from.

    Args:
        resume: ``None``, ``auto`` (newest readable checkpoint of ``folder``, or a fresh start) or a path.
        folder: of the run.

    Raises:
        FaunaError: when a given path does not exist.
    """
    if resume is None:
        return None
    if resume == "auto":
        return newest_checkpoint(folder / "checkpoints")
    path = Path(resume)
    if path.is_dir():
        found = newest_checkpoint(path / "checkpoints" if (path / "checkpoints").is_dir() else path)
        if found is None:
            raise FaunaError(f"resume: expected a folder with checkpoints, got {path} without any; check the path")
        return found
    if not path.is_file():
        raise FaunaError(f"resume: expected auto or a checkpoint, got {resume}, which does not exist; check the path")
    return path


def check_fits(resume: Path, wanted: Mapping[str, Any], optimizers: Sequence[Mapping[str, Any]]) -> None:
    """Refuse a checkpoint that is not one of this model, before anything is loaded from it.

    Args:
        resume: the checkpoint.
        wanted: state dict of the system to be trained.
        optimizers: state dicts of its optimizers.

    Raises:
        FaunaError: naming what does not fit.
    """
    try:
        state = torch.load(resume, map_location="cpu", weights_only=True, mmap=True)
        have, _ = state["state_dict"], state["fauna"]["config"]
        groups = [_groups(each) for each in state["optimizer_states"]]
    except Exception as error:  # a file of another kind raises anything
        raise FaunaError(
            f"resume: expected a checkpoint of fauna-train, got {resume} ({type(error).__name__}); choose one of a run's "
            "checkpoints folder (weights are loaded with init_from)"
        ) from error
    for name in sorted(wanted.keys() ^ have.keys()):
        raise FaunaError(
            f"resume: expected a checkpoint of this model, got {resume} that differs in {name}; compose the same run"
        )
    for name, value in wanted.items():
        if isinstance(value, torch.Tensor) and value.shape != have[name].shape:
            raise FaunaError(
                f"resume: expected {name} of shape {tuple(value.shape)}, got {tuple(have[name].shape)} in {resume}; "
                "compose the same run"
            )
    if groups != [_groups(each) for each in optimizers]:
        raise FaunaError(
            f"resume: expected a checkpoint whose parameters learn in the groups of this version, got {resume} with others; "
            "start anew from its weights with init_from"
        )


def claim_folder(folder: Path, resume: Path | None) -> None:
    """Refuse to mix two runs in one folder.

    Raises:
        FaunaError: when the folder has checkpoints and none of them is continued.
    """
    if resume is None and checkpoints(folder / "checkpoints"):
        raise FaunaError(
            f"out: expected a new folder, got {folder}, which holds checkpoints of another run; "
            "add resume=auto to continue it or choose another out"
        )
    folder.mkdir(parents=True, exist_ok=True)


def report_changes(resume: Path, config: str, photos: str, encoder: str) -> list[str]:
    """What differs between a checkpoint's configuration, photos or environment and now; each line is logged as a warning."""
    state = torch.load(resume, map_location="cpu", weights_only=True, mmap=True)["fauna"]
    old, new = (_flat(OmegaConf.to_container(OmegaConf.create(text))) for text in (state["config"], config))
    lines = []
    for key in sorted(old.keys() | new.keys()):
        if old.get(key) != new.get(key) and not key.startswith(FREE_TO_CHANGE):
            lines.append(f"{key} was {old.get(key)!r} and is now {new.get(key)!r}")
    for key, value in (("photos", photos), ("encoder", encoder)):
        if state[key] != value:
            lines.append(f"{key} were {state[key]} and are now {value}: the run learns from other batches than before")
    now = environment()
    for key, value in state["environment"].items():
        if now.get(key) != value:
            lines.append(f"{key} was {value} and is now {now.get(key)}: results may differ in the last bits")
    for line in lines:
        log.warning("resumed run differs from the interrupted one: %s", line)
    return lines


def write_json(content: Any, path: Path) -> None:
    """Write JSON atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    partial.replace(path)


def _groups(optimizer: Mapping[str, Any]) -> list[tuple[str | None, int]]:
    """Name and number of parameters of each group."""
    return [(group.get("name"), len(group["params"])) for group in optimizer["param_groups"]]


def _flat(node: Any, prefix: str = "") -> dict[str, Any]:
    if not isinstance(node, dict):
        return {prefix: node}
    found: dict[str, Any] = {}
    for key, value in node.items():
        found |= _flat(value, f"{prefix}.{key}" if prefix else str(key))
    return found
