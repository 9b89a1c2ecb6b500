"""Curves of runs: what is read from the log, where the schedule switches, and that the picture shows it."""

import sys

import numpy as np
import pytest
from PIL import Image

from fauna.build import build_schedule
from fauna.errors import FaunaError
from fauna.plots import __main__ as command
from fauna.plots.curves import draw, panels, running_mean
from fauna.plots.log import Curve, RunLog, read_curves, read_run, switches
from tests.runs import composed, reference_run


def test_empty_entries_and_what_is_not_finite_are_passed_over(tmp_path):
    path = tmp_path / "metrics.csv"
    path.write_text("step,loss/mask,val/iou\n9,0.5,\n19,nan,\n29,0.25,0.75\n")
    curves = read_curves(path)
    assert curves["loss/mask"].steps.tolist() == [9, 29]
    assert curves["loss/mask"].values.tolist() == [0.5, 0.25]
    assert curves["val/iou"].steps.tolist() == [29]


@pytest.mark.parametrize("text", [None, "", "a,b\n1,2\n", "step,loss\nx,1\n", "step,loss/mask\n9,\n"])
def test_logs_without_steps_are_refused(tmp_path, text):
    path = tmp_path / "metrics.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(FaunaError, match="^plots: expected .*metrics.csv"):
        read_curves(path)


def test_switches_are_those_of_the_schedule():
    schedule = build_schedule(composed("+experiment=laptop"))
    found = dict(switches(schedule))
    assert list(found) == schedule.boundaries()
    start = schedule.windows["articulation"][0]
    assert "articulation on" in found[start]
    assert not schedule.at(start - 1).articulation
    assert "adversarial off" in found[schedule.windows["adversarial"][1]]
    assert all(found.values())
    assert not any("temperature" in text for text in found.values())


def test_running_mean_against_a_loop():
    values = np.random.default_rng(0).normal(size=23)
    for width in (1, 2, 5, 9):
        first = -((width - 1) // 2 - (width - 1))
        slow = [values[max(0, i - first) : i - first + width].mean() for i in range(len(values))]
        np.testing.assert_allclose(running_mean(values, width), slow)


def test_a_run_without_hydra_folder_is_read_from_its_weights():
    run = read_run(reference_run())
    assert {"loss/total", "val/iou"} <= set(run.curves)
    assert any("articulation on" in text for _, text in run.switches)
    assert max(step for step, _ in run.switches) <= 30


def line(slope: float) -> Curve:
    steps = np.arange(0, 100, 10.0)
    return Curve(steps, 1.0 + slope * steps)


def test_validation_losses_share_the_panel_of_the_training():
    run = RunLog("a", {name: line(0.1) for name in ("loss/mask", "val/mask", "val/iou", "loss/total")}, ())
    assert panels([run]) == ["val/iou", "loss/total", "loss/mask"]


def test_every_run_and_every_switch_is_drawn(tmp_path):
    """Removing one of them changes the picture; drawing again does not."""
    runs = [
        RunLog("a", {"loss/mask": line(0.1)}, ((50, "deformation on"),)),
        RunLog("b", {"loss/mask": line(0.2)}, ()),
    ]
    without = [RunLog("a", {"loss/mask": line(0.1)}, ()), runs[1]]
    pictures = []
    for place, chosen in enumerate((runs, runs, without, runs[:1])):
        draw(chosen, tmp_path / f"{place}.png", smooth=3)
        pictures.append((tmp_path / f"{place}.png").read_bytes())
    assert pictures[0] == pictures[1]
    assert len(set(pictures)) == 3


def test_command(tmp_path, monkeypatch, capsys):
    out = tmp_path / "new" / "curves.png"
    monkeypatch.setattr(sys, "argv", ["plots", str(reference_run()), "--out", str(out), "--smooth", "3"])
    command.main()
    with Image.open(out) as picture:
        assert picture.width > 1000
    for words in (["nowhere", "--out", str(out)], [str(reference_run()), "--out", str(out), "--smooth", "0"]):
        monkeypatch.setattr(sys, "argv", ["plots", *words])
        with pytest.raises(SystemExit) as stopped:
            command.main()
        assert stopped.value.code == 2
        assert capsys.readouterr().err.count("\n") == 1
