"""The wheel carries the configuration and works away from the checkout."""

import importlib.util
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile

import pytest

from fauna._conf import CONF_DIR
from fauna.bank.table import TABLE
from fauna.pretrained.shipped import CARD, CONFIG, INDEX, METRICS, MODEL, WEIGHTS

ROOT = CONF_DIR.parent
MODEL_FILES = {CARD, CONFIG, INDEX, METRICS, TABLE, WEIGHTS}


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A copy of what packages are made of, with a model in it."""
    if importlib.util.find_spec("hatchling") is None or importlib.util.find_spec("pip") is None:
        pytest.skip("needs pip and hatchling to build a wheel")
    if not (ROOT / "pyproject.toml").is_file():
        pytest.skip("not run from a checkout")
    folder = tmp_path_factory.mktemp("source")
    for name in ("src", "conf"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    model = folder / "src" / "fauna" / "pretrained" / MODEL
    model.mkdir(exist_ok=True)
    for name in MODEL_FILES:
        (model / name).touch()
    return folder


@pytest.fixture(scope="module")
def unpacked(source, tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    options = ["--no-deps", "--no-build-isolation", "--quiet", "-w", str(folder)]
    subprocess.run([sys.executable, "-m", "pip", "wheel", *options, str(source)], check=True, timeout=120)
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


def test_the_trained_model_is_inside(unpacked, source, tmp_path):
    assert {path.name for path in (unpacked / "fauna" / "pretrained" / MODEL).iterdir()} == MODEL_FILES
    build = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(tmp_path)]
    subprocess.run(build, cwd=source, check=True, capture_output=True, timeout=120)
    (sdist,) = tmp_path.glob("fauna-*.tar.gz")
    with tarfile.open(sdist) as archive:
        inside = {name.split("/", 1)[1] for name in archive.getnames()}
    assert {f"src/fauna/pretrained/{MODEL}/{name}" for name in MODEL_FILES} <= inside
