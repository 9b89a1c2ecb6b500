"""Composing and running small trainings, in this process and as a command."""

import atexit
import csv
import os
import shutil
import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig
from PIL import Image

from fauna._conf import CONF_DIR
from fauna.train import train

SPECIES = ("long", "round")
QUIET = ("callbacks.preview=null", "callbacks.progress=null")
EVERY_STEP = (
    "callbacks.checkpoints.every_steps=1",
    "callbacks.checkpoints.keep=100",
    "callbacks.checkpoints.every_minutes=1000",
)


def composed(*overrides: str) -> DictConfig:
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return compose("train", overrides=list(overrides))


def run(folder: Path, *overrides: str) -> dict:
    return train(composed(*overrides), folder)


def command(
    *arguments: str, module: str = "fauna.train", seconds: float = 120, **environment: str
) -> subprocess.CompletedProcess:
    """Run a command of the package in its own process."""
    return subprocess.run(
        [sys.executable, "-m", module, *arguments],
        env=command_environment(**environment),
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )


def command_environment(**more: str) -> dict[str, str]:
    """One thread, no network, this checkout's sources."""
    fixed = {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "HF_HUB_OFFLINE": "1", "WANDB_MODE": "offline"}
    return {**os.environ, "PYTHONPATH": str(CONF_DIR.parent / "src"), **fixed, **more}


def logged(folder: Path) -> list[dict[str, float]]:
    """Rows of the CSV log that belong to training steps."""
    with (folder / "logs" / "metrics.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    return [{k: float(v) for k, v in row.items() if v not in ("", None)} for row in rows if row.get("loss/total")]


def state(folder: Path, step: int) -> dict:
    return torch.load(folder / "checkpoints" / f"step-{step:07d}.ckpt", map_location="cpu", weights_only=True)


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


def same_bits(first, second) -> bool:
    try:
        assert_equal_bits(first, second)
    except AssertionError:
        return False
    return True


def blob(species: str, index: int, size: int = 32) -> tuple[np.ndarray, np.ndarray]:
    """A four-legged patch on a ramp: (size, size, 3) colours and (size, size) mask, both 8-bit; no random generator."""
    length, height = {"long": (0.62, 0.20), "round": (0.42, 0.34)}[species]
    shift = 0.04 * ((index % 5) - 2)
    y, x = (np.mgrid[:size, :size] + 0.5) / size * 2.0 - 1.0
    x = x - shift
    body = (x / length) ** 2 + ((y + 0.1) / height) ** 2 < 1.0
    head = (x - length) ** 2 + (y + 0.3) ** 2 < (0.17 + 0.01 * (index % 3)) ** 2
    legs = (np.abs(np.abs(x) - 0.7 * length) < 0.08) & (y > -0.1) & (y < 0.55)
    mask = body | head | legs
    coat = np.stack([0.7 + 0.2 * np.sin(9 * x + index), 0.5 + 0.2 * y, 0.3 + 0.1 * np.cos(7 * y)], axis=-1)
    ground = np.stack([0.3 + 0.2 * y, 0.5 + 0.1 * x, 0.6 - 0.2 * y], axis=-1)
    image = np.where(mask[..., None], coat, ground)
    return (image.clip(0, 1) * 255).round().astype(np.uint8), mask.astype(np.uint8) * 255


def draw_dataset(root: Path, train: int = 4, val: int = 1) -> Path:
    """A ``data=fauna`` folder of two species of :func:`blob`."""
    for species in SPECIES:
        for index in range(train + val):
            folder = root / species / ("train" if index < train else "val")
            folder.mkdir(parents=True, exist_ok=True)
            for part, picture in zip(("rgb", "mask"), blob(species, index), strict=True):
                Image.fromarray(picture).save(folder / f"{'abcdefghij'[index]}_{part}.png")
    return root


@lru_cache(maxsize=1)
def dataset() -> Path:
    """One drawn dataset for the whole session."""
    return draw_dataset(_scratch("dataset") / "blobs")


def tiny(*overrides: str) -> list[str]:
    """``+experiment=tiny`` on the drawn dataset, without pictures and without validation."""
    data = ["data=fauna", f"data.root={dataset()}", "data.on_bad=error", "data.batch_size=2", "data.image_size=32"]
    small = ["data.fit_photos=8", "data.test_max=0", "data.memory_megabytes=50", "trainer.val_every=1000"]
    return ["+experiment=tiny", *data, *small, *QUIET, *overrides]


@lru_cache(maxsize=1)
def reference_run() -> Path:
    """Thirty uninterrupted steps with a checkpoint after each, validated at the end; trained once per session."""
    folder = _scratch("reference")
    run(folder, *tiny(*EVERY_STEP, "trainer.val_every=30"))
    return folder


def _scratch(name: str) -> Path:
    folder = Path(tempfile.mkdtemp(prefix=f"fauna-{name}-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
