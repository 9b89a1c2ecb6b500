"""Time and memory along the axes of size: the script runs, and steps leave nothing behind."""

import gc
import importlib.util
import json
import sys
from pathlib import Path

import pytest
import torch

from fauna.random import Draws
from fauna.threads import set_threads
from tests.test_system import batch, cfg, open_window, system  # noqa: F401

FOLDER = Path(__file__).parents[1] / "benchmarks"
FIELDS = ["axis", "value", "part", "median_ms", "memory_mb", "exponent"]


@pytest.fixture
def growth(monkeypatch):
    """The benchmark script as a module."""
    monkeypatch.syspath_prepend(str(FOLDER))
    spec = importlib.util.spec_from_file_location("growth", FOLDER / "growth.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    threads = torch.get_num_threads()
    yield module
    set_threads(threads)
    torch.use_deterministic_algorithms(False)
    sys.modules.pop("growth_scenes", None)


def test_smoke_run_writes_rows(growth, tmp_path):
    axes = ["image_size", "batch", "spacing", "slots", "rows"]
    growth.main(["--smoke", "--axes", *axes, "--json", str(tmp_path / "rows.json")])
    rows = json.loads((tmp_path / "rows.json").read_text())
    assert all(list(row) == FIELDS for row in rows)
    assert {row["axis"] for row in rows} == set(axes)
    for axis in axes:
        values = sorted({row["value"] for row in rows if row["axis"] == axis})
        assert values == list(growth.VALUES[axis]["smoke"])
        of_axis = [row for row in rows if row["axis"] == axis]
        assert all((row["exponent"] is None) == (row["value"] == values[0]) for row in of_axis)
    assert all(row["median_ms"] > 0 for row in rows)


def test_exponent_is_the_slope_between_neighbours(growth):
    rows = [growth.new_row("batch", n, "step", 3.0 * n**2, None) for n in (1, 2, 8)]
    assert [row["exponent"] for row in growth.with_exponents(rows)] == [None, 2.0, 2.0]


def count_tensors() -> int:
    """Tensors that Python still knows."""
    gc.collect()
    return sum(issubclass(type(each), torch.Tensor) for each in gc.get_objects())  # isinstance would ask lazy objects


@pytest.mark.parametrize("step", [2, 13, 25], ids=["all hypotheses", "adversarial", "deformed"])
def test_a_step_leaves_no_tensor_behind(system, cfg, step):  # noqa: F811
    open_window(system, cfg, step)
    optimizer = system.configure_optimizers()[0]
    photos = batch(system)
    counts = []
    for repeat in range(4):  # the first makes gradients, Adam's moments and constants
        optimizer.zero_grad()
        losses, out, pair = system.generator_losses(photos, Draws(0, repeat))
        losses.total.backward()
        optimizer.step()
        del losses, out, pair
        counts.append(count_tensors())
    assert counts[1] == counts[2] == counts[3]
