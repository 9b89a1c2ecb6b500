"""The extraction benchmark runs and writes the fields that are promised; no time is asserted."""

import json
import subprocess
import sys

from tests.runs import CONF_DIR, command_environment

FIELDS = {"spacing", "dense_ms", "sparse_ms", "ratio", "memory_ratio", "identical"}
EXTRA = {"net", "width", "faces", "components", "gradient_error", "sparse_mib"}


def test_smoke_run_writes_rows(tmp_path):
    script, file = CONF_DIR.parent / "benchmarks" / "extraction.py", tmp_path / "rows.json"
    command = [sys.executable, str(script), "--smoke", "--threads", "1", "--json", str(file)]
    subprocess.run(command, env=command_environment(), check=True, timeout=120)
    (row,) = json.loads(file.read_text())
    assert set(row) == FIELDS | EXTRA
    assert row["identical"] is True
    assert row["gradient_error"] < 1e-4
    assert row["dense_ms"] > 0
    assert row["sparse_ms"] > 0
    assert row["faces"] > 100
