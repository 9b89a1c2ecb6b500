"""The benchmark of segmenters runs, and its rows say what they are said to say."""

import importlib
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

FOLDER = Path(__file__).parents[2] / "benchmarks"


def test_smoke_run(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(FOLDER))
    rng = np.random.default_rng(0)
    (tmp_path / "photos" / "masks").mkdir(parents=True)
    Image.fromarray(rng.integers(0, 255, (60, 80, 3), dtype=np.uint8)).save(tmp_path / "photos" / "a.png")
    Image.fromarray(np.full((60, 80), 255, np.uint8)).save(tmp_path / "photos" / "masks" / "a.png")
    arguments = [
        "--smoke",
        "--threads",
        "1",
        "--photos",
        str(tmp_path / "photos"),
        "--json",
        str(tmp_path / "rows.json"),
    ]
    importlib.import_module("segmenters").main(arguments)
    rows = {row["set"]: row for row in json.loads((tmp_path / "rows.json").read_text())}
    fields = {"segmenter", "set", "photographs", "iou_mean", "iou_median", "above_0.7", "median_ms"}
    assert all(set(row) == fields for row in rows.values())
    assert rows["zoo"]["photographs"] == 2
    assert rows["zoo"]["iou_mean"] > 0.5
    assert rows["photos"]["photographs"] == 1
    assert rows["zoo"]["iou_median"] == pytest.approx(rows["zoo"]["iou_mean"], abs=1e-3)
