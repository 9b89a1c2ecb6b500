"""Which numbers make sense: the ranges of configuration keys that no constructor checks before work starts."""

import math
from collections.abc import Iterator
from typing import Any

from omegaconf import DictConfig, OmegaConf

from fauna.errors import FaunaError

POSITIVE, NOT_NEGATIVE, SHARE = (1, math.inf), (0, math.inf), (0, 1)

RANGES: dict[str, tuple[float, float]] = {
    "seed": (0, 2**32 - 1),
    "shade_fraction": (1e-3, 1),
    "camera.fov_deg": (1, 170),
    "camera.distance": (1e-3, math.inf),
    "feature_space.whitening": SHARE,
    "bank.num_slots": POSITIVE,
    "bank.top_k": POSITIVE,
    "bank.value_dim": POSITIVE,
    "bank.key_init": NOT_NEGATIVE,
    "bank.value_init": NOT_NEGATIVE,
    "bank.init": NOT_NEGATIVE,
    "optimizer.lr": NOT_NEGATIVE,
    "optimizer.prior_lr": NOT_NEGATIVE,
    "optimizer.discriminator_lr": NOT_NEGATIVE,
    "data.batch_size": POSITIVE,
    "data.accumulate": POSITIVE,
    "data.fit_photos": POSITIVE,
    "data.image_size": (8, 4096),
    "data.flip_probability": SHARE,
    "data.valid_margin": (0, 0.49),
    "data.val_fraction": SHARE,
    "data.test_fraction": SHARE,
    "data.val_max": NOT_NEGATIVE,
    "data.test_max": NOT_NEGATIVE,
    "data.memory_megabytes": NOT_NEGATIVE,
    "data.fill_workers": POSITIVE,
    "data.prefetch_steps": NOT_NEGATIVE,
    "data.prefetch_workers": POSITIVE,
    "trainer.max_steps": POSITIVE,
    "trainer.num_nodes": POSITIVE,
    "trainer.threads": POSITIVE,
    "trainer.val_every": POSITIVE,
    "trainer.val_photos": POSITIVE,
    "trainer.log_every": POSITIVE,
    "schedule.start_at": NOT_NEGATIVE,
    "schedule.temperature.start": (1e-9, math.inf),
    "schedule.temperature.stop": (1e-9, math.inf),
    "schedule.temperature.steps": POSITIVE,
    "schedule.best_fraction": SHARE,
    "schedule.lr_decay.factor": SHARE,
    "callbacks.nan_guard.patience": POSITIVE,
    "callbacks.mesh_audit.every_n_steps": POSITIVE,
    "callbacks.preview.every_steps": POSITIVE,
    "callbacks.preview.num_photos": POSITIVE,
    "callbacks.preview.cell": (8, 4096),
    "callbacks.checkpoints.every_steps": POSITIVE,
    "callbacks.checkpoints.every_minutes": (1e-3, math.inf),
    "callbacks.checkpoints.keep": POSITIVE,
    "max_photos": POSITIVE,
    "pictures": POSITIVE,
    "size": (8, 4096),
    "pairs": POSITIVE,
    "bootstrap": POSITIVE,
    "probe_steps": POSITIVE,
    "probe_lr": NOT_NEGATIVE,
    "probe_photos": POSITIVE,
    "threads": POSITIVE,
}


def check_ranges(cfg: DictConfig) -> None:
    """Refuse numbers that are not numbers (nan) or lie outside of :data:`RANGES`.

    Raises:
        FaunaError: on the first.
    """
    for key, value in _numbers(OmegaConf.to_container(cfg, resolve=True), ""):
        low, high = RANGES.get(key, (-math.inf, math.inf))
        if math.isnan(value) or not low <= value <= high:
            raise FaunaError(f"{key}: expected {_spell(low, high)}, got {value}; give another number")


def _numbers(node: Any, path: str) -> Iterator[tuple[str, float]]:
    if isinstance(node, dict):
        for key, value in node.items():
            yield from _numbers(value, f"{path}.{key}" if path else str(key))
    elif isinstance(node, list):
        for value in node:
            yield from _numbers(value, f"{path}[]")
    elif isinstance(node, (int, float)) and not isinstance(node, bool):
        yield path, node


def _spell(low: float, high: float) -> str:
    if low == -math.inf:
        return "a number"
    return f"a number >= {low:g}" if high == math.inf else f"a number from {low:g} to {high:g}"
