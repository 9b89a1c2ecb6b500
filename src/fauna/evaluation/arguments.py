"""Checks the keys of ``fauna-eval`` before anything is loaded; every message names key, expected, received and remedy."""

from typing import Any

from omegaconf import DictConfig, OmegaConf

from fauna.configuration import check_value
from fauna.errors import FaunaError
from fauna.evaluation.baselines import check_baselines
from fauna.evaluation.probes import check_probes
from fauna.evaluation.subjects import SPLITS
from fauna.limits import check_ranges
from fauna.metrics.score import check_settings

TYPES: dict[str, Any] = {
    **dict.fromkeys(("seed", "size", "pairs", "bootstrap", "pictures", "probe_steps", "probe_photos"), int),
    **dict.fromkeys(("max_photos", "threads"), int | None),
    "probe_lr": float,
    "out": str | int,  # a folder may be called 7
    "checkpoint": str | int | None,
    "predictions": str | int | None,
}
NAMES = ("settings", "baselines", "probes")


def check(cfg: DictConfig) -> None:
    """Refuse what cannot work. A single name under :data:`NAMES` becomes a list of one.

    Raises:
        FaunaError: naming the key.
    """
    for key, expected in TYPES.items():
        check_value(key, cfg[key], expected)
    check_ranges(cfg)
    if cfg.out == "":
        raise FaunaError("out: expected a folder, got nothing; give its name or leave the key out")
    if (cfg.checkpoint is None) == (cfg.predictions is None):
        got = "neither" if cfg.checkpoint is None else "both"
        raise FaunaError(f"checkpoint: expected either checkpoint=PATH or predictions=DIR, got {got}; give one of them")
    for key in NAMES:
        cfg[key] = _names(cfg, key)
    if cfg.data.split not in (None, *SPLITS):
        raise FaunaError(f"data.split: expected one of {', '.join(SPLITS)}, got {cfg.data.split!r}; choose one")
    check_settings(cfg.settings)
    check_baselines(cfg.baselines)
    check_probes(cfg.probes)


def _names(cfg: DictConfig, key: str) -> list[str]:
    value = OmegaConf.to_container(cfg[key]) if OmegaConf.is_config(cfg[key]) else cfg[key]
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        got = "null" if value is None else repr(value)
        raise FaunaError(f"{key}: expected a list of names, got {got}; e.g. {key}=[] for none")
    return list(dict.fromkeys(names))
