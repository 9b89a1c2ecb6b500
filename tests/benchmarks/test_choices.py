"""The benchmark of choices measures differences where there are some, and none where there is none."""

import importlib
import json
from pathlib import Path

import pytest

from tests.benchmarks.test_step import deterministic_flags  # noqa: F401

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.mark.usefixtures("deterministic_flags")
def test_smoke_run(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(FOLDER))
    importlib.import_module("choices").main(["--smoke", "--threads", "1", "--json", str(tmp_path / "rows.json")])
    rows = {(row["stage"], row["choice"]): row for row in json.loads((tmp_path / "rows.json").read_text())}
    for stage in ("articulated", "deformed"):
        for name in ("feature_lookup=vertices", "field_precision=bfloat16", "shade_fraction=0.25"):
            row = rows[stage, name]
            assert row["gradient_cosine"] > 0.9
            assert 0 < row["gradient_error"] < 0.5
            assert row["bias"] <= row["gradient_error"] * 3  # the mean gradient is shorter than the gradients
    assert rows["articulated", "feature_lookup=vertices"]["vertex_error"] == 0
    assert 0 < rows["deformed", "field_precision=bfloat16"]["vertex_error"] < 1e-2
