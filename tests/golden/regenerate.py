"""Writes ``tiny.json``: the loss terms of thirty steps of ``+experiment=tiny`` on the drawn dataset of ``tests/runs.py``.

Run it from the checkout, with one thread, after a change that is meant to change the numbers::

    FAUNA_CACHE=$(mktemp -d) OMP_NUM_THREADS=1 PYTHONPATH=src:. python tests/golden/regenerate.py
"""

import json
from pathlib import Path

from fauna.threads import set_threads
from tests.runs import logged, reference_run


def main() -> None:
    set_threads(1)
    rows = [
        {name: float(f"{value:.6g}") for name, value in sorted(row.items()) if name.startswith("loss/")}
        for row in logged(reference_run())
    ]
    lines = ",\n".join(json.dumps(row) for row in rows)
    (Path(__file__).parent / "tiny.json").write_text(f"[\n{lines}\n]\n")


if __name__ == "__main__":
    main()
