"""The inference benchmark writes what it promises."""

import importlib.util
import json
from pathlib import Path

from fauna.threads import set_threads

PATH = Path(__file__).parents[1] / "benchmarks" / "inference.py"


def test_smoke_run_writes_rows(tmp_path):
    spec = importlib.util.spec_from_file_location("inference_benchmark", PATH)
    benchmark = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(benchmark)
    try:
        printed = benchmark.main(["--smoke", "--json", str(tmp_path / "rows.json")])
    finally:
        set_threads(1)
    (row,) = json.loads((tmp_path / "rows.json").read_text())
    assert printed == [row]
    assert list(row) == ["spacing", "median_ms", "parts"]
    assert tuple(row["parts"]) == benchmark.PARTS
    assert row["spacing"] == 32
    assert all(row["parts"][part] > 0 for part in benchmark.PARTS)
    assert 0.5 * row["median_ms"] < sum(row["parts"].values()) < 2 * row["median_ms"]
