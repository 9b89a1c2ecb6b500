"""The benchmark of rigs runs; on the shipped weights bones lie in their legs and standing feet stay where they are."""

import importlib
import json
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "benchmarks"
FIELDS = {
    *("set", "animals", "legs_crossed", "noted", "slide_walk", "slide_trot", "slide_stand", "slide_median"),
    *("skin_error_mean", "skin_error_mean_max", "skin_error_max_median", "skin_error_max"),
}


def test_smoke_run(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(FOLDER))
    printed = importlib.import_module("rigs").main(["--smoke", "--json", str(tmp_path / "rows.json")])
    (row,) = json.loads((tmp_path / "rows.json").read_text())
    assert printed == [row]
    assert set(row) == FIELDS
    assert row["animals"] == 19
    assert row["legs_crossed"] == 0
    assert row["noted"] <= 1
    assert max(row["slide_walk"], row["slide_trot"], row["slide_stand"]) < 0.03
    assert row["skin_error_mean"] < 0.005
