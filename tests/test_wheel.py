"""The wheel carries the configuration and works away from the checkout."""

import importlib.util
import os
import subprocess
import sys
import zipfile

import pytest

from fauna._conf import CONF_DIR

ROOT = CONF_DIR.parent


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    if importlib.util.find_spec("hatchling") is None or importlib.util.find_spec("pip") is None:
        pytest.skip("needs pip and hatchling to build a wheel")
    if not (ROOT / "pyproject.toml").is_file():
        pytest.skip("not run from a checkout")
    folder = tmp_path_factory.mktemp("wheel")
    options = ["--no-deps", "--no-build-isolation", "--quiet", "-w", str(folder)]
    subprocess.run([sys.executable, "-m", "pip", "wheel", *options, str(ROOT)], check=True, timeout=120)
    (wheel,) = folder.glob("fauna-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def test_every_configuration_file_is_inside(unpacked):
    shipped = {path.relative_to(unpacked / "fauna" / "conf") for path in (unpacked / "fauna" / "conf").rglob("*.yaml")}
    assert shipped == {path.relative_to(CONF_DIR) for path in CONF_DIR.rglob("*.yaml")}
    assert not (unpacked / "tests").exists()


def test_it_finds_its_configuration_from_anywhere(unpacked, tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "fauna.train", "--cfg", "job", "+experiment=laptop"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(unpacked)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "num_slots: 60" in done.stdout
    where = subprocess.run(
        [sys.executable, "-c", "from fauna._conf import CONF_DIR; print(CONF_DIR)"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(unpacked)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert where.stdout.strip() == str(unpacked / "fauna" / "conf")
