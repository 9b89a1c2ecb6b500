"""``FaunaModel.from_pretrained`` and everything else that ``pretrained`` names."""

import subprocess
import sys

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from safetensors import safe_open
from safetensors.torch import load_file, save_file

import fauna
from fauna._conf import CONF_DIR
from fauna.data.crop_window import crop_window
from fauna.errors import FaunaError
from fauna.eval import evaluate
from fauna.pretrained import shipped
from fauna.renderer.numba_backend import NumbaRenderer
from fauna.train import train
from tests.pretrained.objects import ship
from tests.runs import assert_equal_bits, blob, command_environment, composed, reference_run, tiny


@pytest.fixture
def package(tmp_path, monkeypatch):
    return ship(tmp_path / "package", monkeypatch)


@pytest.fixture
def empty_package(tmp_path, monkeypatch):
    monkeypatch.setattr(shipped, "_folder", lambda: tmp_path / "nothing")


def tensors(model):
    return {name: value for name, value in model.state_dict().items() if torch.is_tensor(value)}


@pytest.mark.parametrize("part", ["weights.safetensors", ""])
def test_a_path_gives_the_trained_model_with_its_stage(part):
    run = reference_run()
    model = fauna.FaunaModel.from_pretrained(run / part)
    exact = torch.load(run / "checkpoints" / "step-0000030.ckpt", weights_only=True)["state_dict"]
    assert not model.training
    assert model.stage.state() == exact["model._extra_state"]["stage"]
    assert isinstance(model.renderer, NumbaRenderer)
    half = {k: v.half().float() if v.is_floating_point() else v for k, v in tensors(model).items()}
    wanted = {k: exact[f"model.{k}"] for k in half}
    assert_equal_bits(half, {k: v.half().float() if v.is_floating_point() else v for k, v in wanted.items()})


def test_without_a_path_it_is_the_shipped_model(package):
    shipped_one, of_path = fauna.FaunaModel.from_pretrained(), fauna.FaunaModel.from_pretrained(str(reference_run()))
    assert_equal_bits(tensors(shipped_one), tensors(of_path))
    assert_equal_bits(tensors(fauna.FaunaModel.from_pretrained("pretrained")), tensors(of_path))
    assert shipped.shipped_text(shipped.CARD) == "# A card\n"


def test_evaluation_and_fine_tuning_know_it_by_name(package, tmp_path):
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        fast = ["size=32", "pairs=10", "bootstrap=5", "threads=1", "baselines=[]", "pictures=1", "max_photos=1"]
        report = evaluate(compose("eval", overrides=["checkpoint=pretrained", *fast]), tmp_path / "evaluation")
    assert report["protocol"]["checkpoint"]["sha256"] == shipped.sha256((package / shipped.WEIGHTS).read_bytes())
    still = ("trainer.max_steps=1", "optimizer.lr=0", "optimizer.prior_lr=0", "callbacks.checkpoints.half=true")
    train(composed(*tiny("init_from=pretrained", *still)), tmp_path / "tuned")
    tuned = fauna.FaunaModel.from_pretrained(tmp_path / "tuned")
    assert_equal_bits(tensors(tuned), tensors(fauna.FaunaModel.from_pretrained()))


@pytest.mark.parametrize("name", ["weights.safetensors", "card.md"])
def test_a_damaged_file_is_refused(package, name):
    content = bytearray((package / name).read_bytes())
    content[len(content) // 2] ^= 1
    (package / name).write_bytes(bytes(content))
    with pytest.raises(FaunaError, match=rf"^pretrained: expected SHA-256 \w+ in {name} .*install fauna again$"):
        fauna.FaunaModel.from_pretrained()


@pytest.mark.parametrize("content", ["{", "[]", "{}", '{"files": {}}'])
def test_a_damaged_index_is_refused(package, content):
    (package / "index.json").write_text(content)
    with pytest.raises(FaunaError, match=r"^pretrained: expected .* index\.json .*install fauna again$"):
        fauna.FaunaModel.from_pretrained()


def test_a_missing_file_is_refused(package):
    (package / "weights.safetensors").unlink()
    with pytest.raises(FaunaError, match="^pretrained: expected a readable file in weights.safetensors"):
        fauna.FaunaModel.from_pretrained()


def test_a_version_without_a_model_says_so(empty_package, tmp_path):
    with pytest.raises(FaunaError, match="^pretrained: .*no model ships with this version") as raised:
        fauna.FaunaModel.from_pretrained()
    assert "\n" not in str(raised.value)
    with pytest.raises(FaunaError, match="no model ships"):
        train(composed(*tiny("init_from=pretrained")), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_what_does_not_exist_is_named(tmp_path):
    with pytest.raises(FaunaError, match="^checkpoint: .*nowhere"):
        fauna.FaunaModel.from_pretrained("nowhere")
    with pytest.raises(FaunaError, match="^init_from: .*nowhere"):
        train(composed(*tiny("init_from=nowhere")), tmp_path / "run")
    with pytest.raises(FaunaError, match="^device: .*tpu9"):
        fauna.FaunaModel.from_pretrained(reference_run(), device="tpu9")


@pytest.mark.parametrize(("drop", "named"), [(("shape", "sdf", "legs"), "shape.sdf.legs"), (("bank",), "bank")])
def test_weights_of_another_version_are_named(tmp_path, drop, named):
    source = reference_run() / "weights.safetensors"
    with safe_open(source, framework="pt") as handle:
        metadata = dict(handle.metadata())
    node = config = OmegaConf.create(metadata["config"])
    for key in drop[:-1]:
        node = node[key]
    del node[drop[-1]]
    metadata["config"] = OmegaConf.to_yaml(config)
    save_file(load_file(source), tmp_path / "old.safetensors", metadata)
    with pytest.raises(
        FaunaError, match=f"^checkpoint: expected weights of this version, got others .{named}: expected"
    ):
        fauna.FaunaModel.from_pretrained(tmp_path / "old.safetensors")


def test_the_package_starts_without_torch():
    code = "import sys, fauna; assert 'torch' not in sys.modules; print(fauna.__version__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == fauna.__version__
    with pytest.raises(AttributeError, match="no attribute 'Fauna'"):
        fauna.Fauna  # noqa: B018


def test_what_ships_is_small_and_whole():
    """Of the real package: nothing, or a model of at most 12 MB with all its texts."""
    folder = shipped._folder()
    if not folder.joinpath(shipped.INDEX).is_file():
        assert not folder.is_dir() or not [path for path in folder.iterdir() if path.name.endswith(".safetensors")]
        pytest.skip("no model ships with this version")
    assert shipped.shipped_weights().stat().st_size <= shipped.MAX_BYTES
    for name in (shipped.CONFIG, shipped.CARD, shipped.METRICS):
        assert shipped.shipped_text(name)


# --- photographs in memory ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def model():
    return fauna.FaunaModel.from_pretrained(reference_run())


def test_a_photograph_is_cropped_by_its_mask(model):
    """The same animal in a wide photograph and as a crop of that photograph, cut by hand."""
    image, mask = blob("long", 0, size=64)
    wide = np.zeros((90, 140, 3), np.uint8)
    marked = np.zeros((90, 140), np.uint8)
    wide[10:74, 30:94], marked[10:74, 30:94] = image, mask
    rows, columns = np.nonzero(marked)
    bounds = (float(columns.min()), float(rows.min()), columns.max() + 1.0, rows.max() + 1.0)
    left, top, side = crop_window(float(len(rows)), (columns.mean() + 0.5, rows.mean() + 0.5), bounds)
    square = (slice(top + side, top + 2 * side), slice(left + side, left + 2 * side))
    crop = np.ascontiguousarray(np.pad(wide, ((side, side), (side, side), (0, 0)))[square])
    marked_crop = np.ascontiguousarray(np.pad(marked, side)[square])
    out = model.reconstruct(wide, marked, size=side)
    by_hand = model.reconstruct(crop, marked_crop, crop=False, size=side)
    assert out.renders.silhouette.shape == (1, side, side)
    assert torch.equal(out.posed.verts, by_hand.posed.verts)
    assert torch.equal(out.camera.clip_from_world, by_hand.camera.clip_from_world)
    assert torch.equal(model.reconstruct(wide, marked > 0, size=side).posed.verts, out.posed.verts)


@pytest.mark.parametrize(
    ("image", "mask", "message"),
    [
        (np.zeros((8, 8)), np.zeros((8, 8), bool), "image: expected .* 8-bit RGB, got float64"),
        (np.zeros((8, 9, 3), np.uint8), np.zeros((9, 8), bool), r"mask: .*\(8, 9\), got bool of shape \(9, 8\)"),
        (np.zeros((8, 9, 3), np.uint8), np.zeros((8, 9)), "mask: expected truth values or 8 bits"),
        (np.zeros((8, 9, 3), np.uint8), np.zeros((8, 9), bool), "mask: expected an animal, got an empty mask"),
    ],
)
def test_arrays_of_another_form_are_refused(model, image, mask, message):
    with pytest.raises(FaunaError, match=f"^{message}"):
        model.reconstruct(image, mask)


def test_a_crop_is_square(model):
    with pytest.raises(FaunaError, match="^image: expected a square crop, got 9x8"):
        model.reconstruct(np.zeros((8, 9, 3), np.uint8), np.ones((8, 9), bool), crop=False)


def test_masks_of_zeros_and_ones_mark_the_animal(model):
    image, mask = blob("long", 0, size=64)
    ones = (mask > 0).astype(np.uint8)
    out, same = (model.reconstruct(image, each, size=32) for each in (mask, ones))
    assert torch.equal(out.posed.verts, same.posed.verts)


@pytest.mark.parametrize("size", [0, -3, 100_000])
def test_sizes_have_a_range(model, size):
    with pytest.raises(FaunaError, match="^size: expected a whole number from 8 to 4096"):
        model.reconstruct(*blob("long", 0, size=64), size=size)


WRONG_TYPES = """
import sys
import numpy as np
import fauna
from fauna.errors import FaunaError

found = fauna.load(sys.argv[1])
model, image, mask = found.model, np.zeros((64, 64, 3), np.uint8), np.ones((64, 64), bool)
result = found.reconstruct(image, mask=mask)
for call in (
    lambda: fauna.FaunaModel.from_pretrained(sys.argv[1], device=None),
    lambda: model.reconstruct(None, mask),
    lambda: model.reconstruct(image, None),
    lambda: model.reconstruct(image, mask, size=64.5),
    lambda: fauna.load(sys.argv[1], settings={}),
    lambda: fauna.load(sys.argv[1], segmenter=3),
    lambda: found.reconstruct(None),
    lambda: found.reconstruct(image, mask=3),
    lambda: found.reconstruct(image, mask=mask.tolist()),
    lambda: found.reconstruct_all(image, masks=3),
    lambda: found.reconstruct_all(image, masks=[None]),
    lambda: found.morph(result, result, frames=2.5),
    lambda: found.morph(result, result, frames=None),
    lambda: found.morph(result, result, frames=3, masks=3),
    lambda: found.transfer_pose(result, result, masks=(mask,)),
    lambda: found.sample_bank(mixtures=2.5, seed=0),
    lambda: found.sample_bank(mixtures=1, seed=None),
):
    try:
        call()
    except FaunaError as error:
        assert "expected" in str(error) and chr(10) not in str(error), error
    else:
        raise AssertionError("taken")
    print("refused")
"""


def test_arguments_of_another_kind_get_one_line():
    """In a process of its own, where nothing checks types before the functions do."""
    words = [sys.executable, "-c", WRONG_TYPES, str(reference_run())]
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=command_environment())
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("refused") == 17


@pytest.mark.parametrize("content", [[1], torch.zeros(3), {"state_dict": {}}, {"model": torch.nn.ReLU}])
def test_files_of_other_programs_are_named(tmp_path, content):
    torch.save(content, tmp_path / "other.ckpt")
    with pytest.raises(FaunaError, match="^expected fauna weights .* the file is damaged or of another program"):
        fauna.FaunaModel.from_pretrained(tmp_path / "other.ckpt")
