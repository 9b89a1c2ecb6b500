"""Documents, notebook, benchmark and gates say what is true."""

import json
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch
import yaml
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig, OmegaConf
from PIL import Image

from fauna._conf import CONF_DIR
from fauna.configuration import validate
from fauna.data.fauna_folder import read_fauna_folder
from fauna.data.photo_loader import FEATURE_MAP_CHANNELS, PhotoLoader
from fauna.encoder.tiny import TinyEncoder
from tests.runs import composed, run

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), ROOT / "benchmarks" / "README.md"])
GROUPS = {path.name for path in CONF_DIR.iterdir() if path.is_dir()}
TINY = ("+experiment=tiny",)


def blocks(document: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", document.read_text(), flags=re.DOTALL)


def spans(document: Path) -> set[str]:
    """Text in backticks outside code blocks."""
    prose = re.sub(r"```.*?```", "", document.read_text(), flags=re.DOTALL)
    return set(re.findall(r"`([^`\n]+)`", prose))


# --- documents ---------------------------------------------------------------------------------------------------


def test_documents_are_found():
    names = {path.name for path in DOCUMENTS}
    assert {"README.md", "CHANGELOG.md", "architecture.md", "conventions.md", "decisions.md", "data.md"} <= names


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_and_paths_exist(document):
    text = document.read_text()
    links = [link.split("#")[0] for link in re.findall(r"\]\(([^)]+)\)", text) if "://" not in link]
    missing = [link for link in links if not (document.parent / link).exists()]
    folders = r"(?:src/fauna|conf|tests|benchmarks|docs|notebooks)"
    example = {"src/fauna/bank/mean.py", "conf/bank/mean.yaml"}  # what the worked example adds
    paths = {span for span in spans(document) if re.fullmatch(rf"{folders}/[\w./-]*", span)} - example
    assert not missing
    assert not [path for path in paths if not (ROOT / path).exists()]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_no_machine_is_mentioned(document):
    assert not re.search(r"(^|[\s(`\"'])/(work|tmp|home|root|opt)/", document.read_text())


def test_architecture_lists_every_config_group():
    table = (ROOT / "docs" / "architecture.md").read_text().split("## Config groups")[1].split("## Adding")[0]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    named = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert named == GROUPS


@pytest.mark.parametrize(
    "document", [ROOT / "docs" / name for name in ("decisions.md", "data.md")], ids=lambda p: p.name
)
def test_named_keys_exist(document):
    roots = GROUPS | {"seed", "resume", "out", "init_from", "init_components", "feature_lookup", "batch_code", "camera"}
    keys = {span for span in spans(document) if re.fullmatch(r"[a-z]\w*(\.[a-z]\w*)+", span)}
    keys = {key for key in keys if key.split(".")[0] in roots and Path(key).suffix not in (".py", ".md", ".yaml")}
    configs = [composed(f"+experiment={name}") for name in ("laptop", "quadruped")]
    configs += [composed(f"data={path.stem}") for path in (CONF_DIR / "data").glob("*.yaml")]
    configs += [DictConfig(OmegaConf.load(CONF_DIR / f"{name}.yaml")) for name in ("reconstruct", "prepare")]
    assert len(keys) > 8
    unknown = [key for key in sorted(keys) if not any(_has(cfg, key) for cfg in configs)]
    assert not unknown


def _has(cfg: DictConfig, key: str) -> bool:
    parent, _, name = key.rpartition(".")
    node = OmegaConf.select(cfg, parent)
    return isinstance(node, DictConfig) and name in node


def test_file_choices_in_decisions_exist():
    named = {span for span in spans(ROOT / "docs" / "decisions.md") if re.fullmatch(r"\w+=\w+", span)}
    files = [choice for choice in named if choice.split("=")[0] in GROUPS]
    assert files
    assert all((CONF_DIR / f"{choice.replace('=', '/')}.yaml").is_file() for choice in files)


# --- the worked example of architecture.md -----------------------------------------------------------------------


def test_worked_example_trains(tmp_path, monkeypatch):
    architecture = ROOT / "docs" / "architecture.md"
    (code,), (config,) = blocks(architecture, "python"), blocks(architecture, "yaml")
    module = ModuleType("fauna.bank.mean")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(code, "docs/architecture.md", "exec"), module.__dict__)
    (tmp_path / "conf" / "bank").mkdir(parents=True)
    (tmp_path / "conf" / "bank" / "mean.yaml").write_text(config)
    search = f"hydra.searchpath=[file://{tmp_path / 'conf'}]"
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        cfg = compose("train", overrides=[*TINY, "bank=mean", "trainer.max_steps=2", search])
    validate(cfg)

    from fauna.train import train

    train(cfg, tmp_path / "run")
    state = torch.load(tmp_path / "run" / "checkpoints" / "step-0000002.ckpt", weights_only=True)["state_dict"]
    assert state["model.bank.values"].shape == (60, 64)
    bank = module.MeanBank(num_slots=5, value_dim=3, init=0.1)
    readout = bank(torch.zeros(2, 7), None)
    torch.testing.assert_close(readout.embedding, bank.values.mean(0).expand(2, -1))


# --- the folder of data.md ---------------------------------------------------------------------------------------


def test_documented_folder_becomes_a_batch(tmp_path):
    train = tmp_path / "horse" / "train"
    train.mkdir(parents=True)
    rng = np.random.default_rng(0)
    mask = np.zeros((64, 64), np.uint8)
    mask[16:48, 10:50] = 255
    maps = rng.integers(0, 255, (8, 8 * 6, 3), dtype=np.uint8)  # 16 channels in six RGB tiles
    for name in ("0001", "0002"):
        Image.fromarray(rng.integers(0, 255, (64, 64, 3), dtype=np.uint8)).save(train / f"{name}_rgb.jpg")
        Image.fromarray(mask).save(train / f"{name}_mask.png")
        Image.fromarray(maps).save(train / f"{name}_feat16.png")
        (train / f"{name}_box.txt").write_text("0 -16 0 64 64 100 100 0\n")
        (train / f"{name}_keypoints.json").write_text('{"keypoints": [[3, 4, 1]]}')
    photos = read_fauna_folder(tmp_path, photograph_pattern=r"(.+_\d+)_\d+")["horse"].train
    encoder = TinyEncoder(input_size=64, stride=8, token_dim=24, seed=0)
    loader = PhotoLoader(encoder=encoder, image_size=32, valid_margin=0.02, cache_features=False, memory_megabytes=10)
    batch = loader.batch(photos, [False, True], None)
    assert batch.images.shape == (2, 3, 32, 32)
    assert batch.feature_targets is not None
    assert batch.feature_targets.shape == (2, FEATURE_MAP_CHANNELS, 8, 8)
    expected = torch.from_numpy(maps[:, 8:16, 1].astype(np.float32)) / 255  # channel 4: second tile, green
    torch.testing.assert_close(batch.feature_targets[0, 4], expected)
    torch.testing.assert_close(batch.feature_targets[1, 4], expected.flip(-1))
    assert batch.valid[0, :, :8].sum() == 0  # left of the photograph
    assert batch.valid[1, :, -8:].sum() == 0


# --- notebook ----------------------------------------------------------------------------------------------------


def test_notebooks_are_stripped_and_run(tmp_path, monkeypatch):
    path = ROOT / "notebooks" / "01_quickstart.ipynb"  # the others: tests/notebooks
    cells = [cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code"]
    assert 4 <= len(cells) <= 6
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    monkeypatch.setenv("FAUNA_RUNS", str(tmp_path))
    run(tmp_path / "quickstart" / "now", *TINY, "trainer.max_steps=4")  # stands for a finished quickstart
    namespace: dict = {"__name__": "notebook"}
    for cell in cells:
        exec(compile("".join(cell["source"]), path.name, "exec"), namespace)
    assert namespace["weights"] == tmp_path / "quickstart" / "now" / "weights.safetensors"
    assert namespace["sheet"].width == 10 * 96
    side = np.asarray(namespace["side"].convert("L"))
    assert side.shape == (256, 256)
    assert 0.02 < (side < 250).mean() < 0.9  # something is seen, on white


# --- gates -------------------------------------------------------------------------------------------------------


def test_gate_installs_as_the_readme_says():
    script = (ROOT / ".ci" / "run").read_text()
    (install,) = [
        line for block in blocks(ROOT / "README.md", "bash") for line in block.splitlines() if "venv .venv" in line
    ]
    (test,) = [line for block in blocks(ROOT / "README.md", "bash") for line in block.splitlines() if "pytest" in line]
    for command in re.findall(r"pip install [^&]+", install):
        assert command.strip().removeprefix("pip install ") in script
    assert test.strip() in script
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o100
    for gate in ("ruff check", "ruff format --check", "pyright"):
        assert gate in script


@pytest.mark.parametrize("name", [".github/workflows/ci.yml", ".pre-commit-config.yaml"])
def test_hosted_gates_are_yaml(name):
    text = (ROOT / name).read_text()
    assert yaml.safe_load(text)
    assert "ruff" in text or ".ci/run" in text


def test_changelog_has_an_unreleased_block():
    headings = re.findall(r"^## \[([^\]]+)\]", (ROOT / "CHANGELOG.md").read_text(), flags=re.MULTILINE)
    assert headings[0] == "Unreleased"
