"""The benchmark of preparation writes what it promises."""

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_smoke_run_writes_rows(tmp_path):
    command = [
        sys.executable,
        "benchmarks/prepare.py",
        "--smoke",
        "--encoder",
        "tiny",
        "--json",
        str(tmp_path / "rows.json"),
    ]
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    rows = json.loads((tmp_path / "rows.json").read_text())
    assert {tuple(row) for row in rows} == {("stage", "photographs", "ms_each", "bytes_each", "peak_megabytes")}
    assert {"scan", "mask", "crop", "filter", "features", "mask, grabcut", "manifest", "duplicates, found"} <= {
        row["stage"] for row in rows
    }
    assert all(row["peak_megabytes"] > 10 and row["ms_each"] >= 0 for row in rows)
