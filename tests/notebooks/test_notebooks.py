"""The notebooks: stored without outputs, and what they show when they are run."""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fauna._conf import CONF_DIR

ROOT = CONF_DIR.parent
FOLDER = ROOT / "notebooks"
NAMES = ("reconstruct", "explore_the_bank", "train_on_your_own_photos")
needs_jupyter = pytest.mark.skipif(
    importlib.util.find_spec("nbclient") is None or importlib.util.find_spec("ipykernel") is None,
    reason="needs nbclient",
)


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.ipynb")), ids=lambda path: path.stem)
def test_stored_without_outputs(path):
    content = json.loads(path.read_text(encoding="utf-8"))
    code = [cell for cell in content["cells"] if cell["cell_type"] == "code"]
    assert code
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    assert len({cell["id"] for cell in content["cells"]}) == len(content["cells"])
    assert str(Path.home()) + "/" not in path.read_text(encoding="utf-8")


def test_the_script_knows_every_notebook():
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == {"01_quickstart", *NAMES}


@needs_jupyter
@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_runs_and_shows_the_animal(name, tmp_path):
    """The first always, the others, which draw and train, with FAUNA_TEST_NOTEBOOKS=1."""
    if name != NAMES[0] and not os.environ.get("FAUNA_TEST_NOTEBOOKS"):
        pytest.skip("takes minutes; set FAUNA_TEST_NOTEBOOKS=1")
    environment = {**os.environ, "FAUNA_NOTEBOOK_STEPS": "3", "FAUNA_NOTEBOOK_PHOTOS": "6"}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    done = subprocess.run(
        [sys.executable, str(FOLDER / "run.py"), name, "--keep", str(tmp_path)],
        env=environment, capture_output=True, text=True, timeout=550, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    cells = json.loads((tmp_path / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    shown = [output["data"] for cell in cells for output in cell.get("outputs", ()) if "data" in output]
    assert any("srcdoc" in "".join(data.get("text/html", "")) for data in shown)
    assert any("image/png" in data for data in shown)
