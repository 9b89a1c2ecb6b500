"""Panels of curves, one for each logged quantity, with vertical lines where the schedule switches something."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fauna.errors import FaunaError
from fauna.plots.log import Curve, RunLog

FIRST = ("val/iou", "loss/total")
COLUMNS = 4
PANEL = (3.6, 2.3)
"""Width and height, inches."""
COLOURS = ("#1f5fa8", "#c8501e", "#2f8f5b", "#8a4fa3", "#a08a1e", "#5a5a5a")
NOW_AND_THEN = ("val/", "audit/")
"""Quantities of single steps, drawn as dots; the others are noisy and smoothed."""
DEGREES = ("model/angle_rms",)
"""Logged in radians, drawn in degrees."""


def draw(runs: Sequence[RunLog], path: Path, *, smooth: int) -> None:
    """Write a PNG: training losses (thin as logged, thick smoothed) with the validation's beside them, and metrics.

    Args:
        runs: drawn over each other, one colour each.
        path: of the picture.
        smooth: entries of the log in the running mean.

    Raises:
        FaunaError: when ``smooth`` is no positive number, or the picture cannot be written.
    """
    if smooth < 1:
        raise FaunaError(f"plots: expected --smooth of at least 1, got {smooth}; 1 draws the log as it is")
    names = panels(runs)
    rows = math.ceil(len(names) / COLUMNS)
    legend = _legend(runs)
    margin = 0.3 + 0.17 * len(legend)  # inches below the panels
    height = rows * PANEL[1] + margin
    figure = Figure(figsize=(COLUMNS * PANEL[0], height), dpi=100, layout="constrained")
    figure.get_layout_engine().set(rect=(0, margin / height, 1, 1 - margin / height))  # type: ignore[union-attr]
    grid = figure.subplots(rows, COLUMNS, squeeze=False, sharex=True).ravel()
    for axes, name in zip(grid, names, strict=False):
        _panel(axes, name, runs, smooth)
    for axes in grid[len(names) :]:
        axes.set_axis_off()
    for axes in grid:
        axes.tick_params(labelbottom=True)
    for place, (text, colour) in enumerate(legend):
        figure.text(0.008, (margin - 0.22 - 0.17 * place) / height, text, color=colour, fontsize=8, va="top")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, format="png", metadata={"Software": None})
    except OSError as error:
        raise FaunaError(
            f"plots: expected a file to write, got --out {path} ({error.strerror}); choose another"
        ) from error


def panels(runs: Sequence[RunLog]) -> list[str]:
    """Quantities with a panel of their own: validation losses are drawn in that of the training's."""
    names = {name for run in runs for name in run.curves}
    own = {name for name in names if not (name.startswith("val/") and f"loss/{name[4:]}" in names)}

    def rank(name: str) -> tuple[int, str]:
        groups = ("loss/", "val/", "model/", "bank/")
        group = next((place for place, prefix in enumerate(groups) if name.startswith(prefix)), len(groups))
        return (-len(FIRST) + FIRST.index(name) if name in FIRST else group, name)

    return sorted(own, key=rank)


def running_mean(values: Float[np.ndarray, " entry"], width: int) -> Float[np.ndarray, " entry"]:
    """Mean of the ``width`` entries around each, of fewer at the ends.

    >>> running_mean(np.array([1.0, 2.0, 6.0]), 3).tolist()
    [1.5, 3.0, 4.0]
    """
    total = np.convolve(values, np.ones(width), mode="full")
    count = np.convolve(np.ones_like(values), np.ones(width), mode="full")
    start = (width - 1) // 2
    return (total / count)[start : start + len(values)]


def _panel(axes: Axes, name: str, runs: Sequence[RunLog], smooth: int) -> None:
    everything = []
    for run, colour in zip(runs, _colours(runs), strict=True):
        for step, _ in run.switches:
            axes.axvline(step, color=colour if len(runs) > 1 else "#999999", linewidth=0.6, linestyle=":", zorder=0)
        if name in run.curves:
            curve = run.curves[name]
            everything.append(_trace(axes, name, curve, colour, smooth))
        beside = run.curves.get(f"val/{name[5:]}") if name.startswith("loss/") else None
        if beside is not None:
            axes.plot(
                beside.steps, beside.values, color=colour, marker="o", markersize=2.5, linewidth=0.8, linestyle="--"
            )
            everything.append(beside.values)
    lowest = min((values.min() for values in everything), default=0.0)
    if name.startswith("loss/") and lowest > 0:
        axes.set_yscale("log")
    axes.set_title(f"{name}, degrees" if name in DEGREES else name, fontsize=9, loc="left")
    axes.tick_params(labelsize=7)
    axes.tick_params(which="minor", labelsize=6)
    axes.grid(alpha=0.25, linewidth=0.5)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _trace(axes: Axes, name: str, curve: Curve, colour: str, smooth: int) -> Float[np.ndarray, " entry"]:
    """One curve; returns what was drawn."""
    values = np.degrees(curve.values) if name in DEGREES else curve.values
    if name.startswith(NOW_AND_THEN):
        axes.plot(curve.steps, values, color=colour, linewidth=1.2, marker="o", markersize=2.5)
        return values
    axes.plot(curve.steps, values, color=colour, linewidth=0.5, alpha=0.35)
    axes.plot(curve.steps, running_mean(values, smooth), color=colour, linewidth=1.3)
    return values


def _colours(runs: Sequence[RunLog]) -> list[str]:
    return [COLOURS[place % len(COLOURS)] for place in range(len(runs))]


def _legend(runs: Sequence[RunLog]) -> list[tuple[str, str]]:
    """Lines of text below the panels with their colours: how to read them, then each run and its switches."""
    lines = [
        ("line: training, smoothed over its log; dots: validation; dotted verticals: the schedule switches", "#444444")
    ]
    for run, colour in zip(runs, _colours(runs), strict=True):
        words = [f"{step} {text}" for step, text in run.switches]
        parts, width = [f"{run.name}:"], 190
        for word in words:
            if len(parts[-1]) + len(word) > width:
                parts.append("   ")
            parts[-1] += f"  |  {word}" if parts[-1].strip() not in ("", f"{run.name}:") else f" {word}"
        lines += [(part, colour) for part in parts]
    return lines
