"""The texture benchmark writes what it promises."""

import importlib.util
import json
from pathlib import Path

from fauna.threads import set_threads

PATH = Path(__file__).parents[2] / "benchmarks" / "texture.py"


def test_smoke_run_writes_rows(tmp_path):
    spec = importlib.util.spec_from_file_location("texture_benchmark", PATH)
    benchmark = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(benchmark)
    try:
        printed = benchmark.main(["--smoke", "--json", str(tmp_path / "rows.json")])
    finally:
        set_threads(1)
    (row,) = json.loads((tmp_path / "rows.json").read_text())
    assert printed == [row]
    assert tuple(row) == benchmark.FIELDS
    assert all(row[field] is not None for field in benchmark.FIELDS)
    assert row["photographs"] == "zoo"
    assert row["count"] == 1
    assert row["total_s"] > 0
    assert 0 < row["iou_before"] <= 1
