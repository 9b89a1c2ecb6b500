"""What a run folder tells about its course: logged values by step, and the steps at which the schedule switches something."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from hydra.utils import instantiate
from jaxtyping import Float
from omegaconf import DictConfig, OmegaConf

from fauna.errors import FaunaError
from fauna.evaluation.weights import locate
from fauna.io.checkpoint import read_weights
from fauna.stages import Schedule, Stage

CONTINUOUS = ("temperature", "uniform_mix", "best_fraction", "lr_scale")
"""Of a stage, what changes at every step."""


@dataclass(frozen=True)
class Curve:
    """One logged quantity.

    Attributes:
        steps: ascending.
        values: finite.
    """

    steps: Float[np.ndarray, " entry"]
    values: Float[np.ndarray, " entry"]


@dataclass(frozen=True)
class RunLog:
    """The course of a run.

    Attributes:
        name: of its folder.
        curves: by the name in ``logs/metrics.csv``.
        switches: (step, what changes there), ascending.
    """

    name: str
    curves: dict[str, Curve]
    switches: tuple[tuple[int, str], ...]


def read_run(folder: Path) -> RunLog:
    """Read the log and the schedule of a run, finished or not.

    Raises:
        FaunaError: when the folder is none of a run with a CSV log.
    """
    curves = read_curves(folder / "logs" / "metrics.csv")
    last = max(curve.steps[-1] for curve in curves.values())
    schedule: Schedule = instantiate(_config(folder).schedule, _convert_="all")
    return RunLog(folder.resolve().name, curves, tuple((s, text) for s, text in switches(schedule) if s <= last))


def read_curves(path: Path) -> dict[str, Curve]:
    """Columns of a CSV log without their empty entries and without what is not finite.

    Raises:
        FaunaError: when there is no such log, or nothing in it.
    """
    try:
        with path.open(newline="", encoding="utf-8") as handle:
            rows = [(float(row.pop("step")), row) for row in csv.DictReader(handle)]
        names = sorted({name for _, row in rows for name, text in row.items() if name and text})
        found = {name: [(step, float(row[name])) for step, row in rows if row.get(name)] for name in names}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FaunaError(
            f"plots: expected a run folder with logs/metrics.csv, got {path} ({type(error).__name__}); check the path, and "
            "train with logger=files"
        ) from error
    curves = {}
    for name, pairs in found.items():
        entries = np.array(pairs, np.float64)
        entries = entries[np.isfinite(entries[:, 1])]
        if len(entries):
            curves[name] = Curve(entries[:, 0], entries[:, 1])
    if not curves:
        raise FaunaError(f"plots: expected logged steps, got none in {path}; let the run go on for a while")
    return curves


def switches(schedule: Schedule) -> list[tuple[int, str]]:
    """Every step at which something jumps, in words."""
    return [(step, ", ".join(_changes(schedule.at(step - 1), schedule.at(step)))) for step in schedule.boundaries()]


def _changes(before: Stage, after: Stage) -> list[str]:
    """What differs between two stages, without what changes all the time."""
    words = []
    for name, new in after.state().items():
        old = getattr(before, name)
        if name in CONTINUOUS or old == new:
            continue
        if isinstance(new, bool):
            words.append(f"{name} {'on' if new else 'off'}")
        elif isinstance(new, dict):
            words += [f"{name}.{key} {new[key]:g}" for key in new if new[key] != old.get(key)]
        else:
            words.append(f"{name} {new}")
    return words


def _config(folder: Path) -> DictConfig:
    stored = folder / ".hydra" / "config.yaml"
    if stored.is_file():
        loaded = OmegaConf.load(stored)
        assert isinstance(loaded, DictConfig)
        return loaded
    return DictConfig(read_weights(locate(str(folder)))[1]["config"])
