"""Composing and running small trainings in process."""

import csv
from pathlib import Path

import torch
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig

from fauna._conf import CONF_DIR
from fauna.train import train

TINY = ["+experiment=tiny"]


def composed(*overrides: str) -> DictConfig:
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return compose("train", overrides=list(overrides))


def run(folder: Path, *overrides: str) -> dict:
    return train(composed(*overrides), folder)


def logged(folder: Path) -> list[dict[str, float]]:
    """Rows of the CSV log that belong to training steps."""
    with (folder / "logs" / "metrics.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    return [{k: float(v) for k, v in row.items() if v not in ("", None)} for row in rows if row.get("loss/total")]


def state(folder: Path, step: int) -> dict:
    return torch.load(folder / "checkpoints" / f"step={step:07d}.ckpt", map_location="cpu", weights_only=True)


def assert_equal_bits(first, second, path: str = "") -> None:
    """Recursively, bit for bit."""
    assert type(first) is type(second), path
    if isinstance(first, torch.Tensor):
        assert torch.equal(first, second), path
    elif isinstance(first, dict):
        assert first.keys() == second.keys(), path
        for key in first:
            assert_equal_bits(first[key], second[key], f"{path}/{key}")
    elif isinstance(first, (list, tuple)):
        assert len(first) == len(second), path
        for index, (a, b) in enumerate(zip(first, second, strict=True)):
            assert_equal_bits(a, b, f"{path}/{index}")
    else:
        assert first == second, path
