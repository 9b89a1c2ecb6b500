"""The step benchmark writes what it promises, and its naive step is the same step."""

import importlib
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from fauna.random import Draws
from fauna.threads import set_threads
from tests.test_system import batch, cfg, open_window, system  # noqa: F401

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def load(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module


@pytest.fixture
def deterministic_flags() -> Iterator[None]:
    """Undo what a script sets for its whole process."""
    before = torch.are_deterministic_algorithms_enabled(), torch.utils.deterministic.fill_uninitialized_memory
    yield
    torch.use_deterministic_algorithms(before[0])
    torch.utils.deterministic.fill_uninitialized_memory = before[1]
    set_threads(1)


@pytest.mark.usefixtures("deterministic_flags")
def test_smoke_run_writes_a_row_per_stage(load, tmp_path):
    load("step").main(["--smoke", "--json", str(tmp_path / "rows.json")])
    rows = json.loads((tmp_path / "rows.json").read_text())
    assert [row["stage"] for row in rows] == ["before articulation", "articulated", "adversarial", "deformed"]
    for row in rows:
        assert list(row) == [
            *("experiment", "image_size", "threads", "stage", "median_ms", "naive_ms", "ratio", "parts")
        ]
        assert row["ratio"] == pytest.approx(row["naive_ms"] / row["median_ms"], rel=0.05)
        assert {"data", "shape", "render", "losses", "backward", "optimizer"} <= set(row["parts"])
        assert all(0 <= ms <= 2 * row["median_ms"] for ms in row["parts"].values())
    parts = {row["stage"]: set(row["parts"]) for row in rows}
    assert "articulation" not in parts["before articulation"]
    assert {"skeleton", "articulation", "skinning"} <= parts["articulated"]
    assert {stage for stage, names in parts.items() if "discriminator" in names} == {"adversarial"}


@pytest.mark.parametrize("step", [0, 13, 25])
def test_the_naive_step_has_the_same_losses_and_gradients(load, system, cfg, step):  # noqa: F811
    stage = open_window(system, cfg, step)
    system.model.feature_lookup = "pixels"  # the naive step knows no other
    photos, found = batch(system), []
    for structure in (load("contextlib").nullcontext, lambda: load("naive").naive_structure(system)):
        system.zero_grad()
        with structure():
            losses = system.generator_losses(photos, Draws(0, 0))[0]
            rest = (
                losses.total - stage.weight("eikonal") * losses.terms["eikonal"]
            )  # at other points: vertices are in another order
            rest.backward()
        grads = [p.grad.flatten() for p in system.model.parameters() if p.grad is not None]
        found.append((losses.terms, torch.cat(grads)))
    (ours, our_grad), (naive, naive_grad) = found
    assert set(ours) == set(naive)
    for name in set(ours) - {"eikonal"}:
        torch.testing.assert_close(ours[name], naive[name], rtol=1e-4, atol=1e-6)
    assert ((our_grad - naive_grad).norm() / naive_grad.norm()).item() < 1e-3
