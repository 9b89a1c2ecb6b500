"""Weight files and checkpoints: what is written is what is read, and what does not fit is refused."""

import json
import subprocess
import sys

import pytest
import torch
from hydra.core.global_hydra import GlobalHydra
from PIL import Image
from safetensors.torch import load_file

import fauna.eval
from fauna.build import build_encoder, build_model
from fauna.configuration import validate
from fauna.errors import FaunaError
from fauna.io import checkpoint as module
from fauna.io.checkpoint import load_weights, read_weights, save_weights
from fauna.io.contact_sheet import save_png
from fauna.io.run_folder import write_json
from fauna.stages import Stage
from tests.runs import assert_equal_bits, composed, reference_run, run, same_bits, state, tiny

CONFIG = "name: test\n"


@pytest.fixture(scope="module")
def reference():
    return reference_run()


def model_of(*overrides: str):
    cfg = composed(*tiny(*overrides))
    validate(cfg)
    return build_model(cfg, build_encoder(cfg))


def tensors(model) -> dict[str, torch.Tensor]:
    return {name: value for name, value in model.state_dict().items() if torch.is_tensor(value)}


@pytest.mark.parametrize("half", [False, True])
def test_round_trip(tmp_path, half):
    torch.manual_seed(1)
    model, other = model_of(), model_of()
    model.set_stage(Stage(articulation=False, leg_limits="early", temperature=0.25, weights={"mask": 3.0}))
    save_weights(model, tmp_path / "w.safetensors", config=CONFIG, species=["dog", "horse"], half=half)
    metadata = load_weights(other, tmp_path / "w.safetensors")
    assert other.stage == model.stage == metadata["stage"]
    assert metadata["config"] == {"name": "test"}
    assert metadata["encoder"] == model.encoder.fingerprint
    for name, value in tensors(model).items():
        expected = value.half().float() if half and value.is_floating_point() else value
        assert torch.equal(tensors(other)[name], expected), name
    dtypes = {value.dtype for value in load_file(tmp_path / "w.safetensors").values() if value.is_floating_point()}
    assert dtypes == ({torch.float16} if half else {torch.float32})
    assert not any(name.startswith("encoder.") for name in load_file(tmp_path / "w.safetensors"))


def test_checkpoint_and_weight_file_of_a_run_agree(reference):
    exact, rounded = model_of(), model_of()
    load_weights(exact, reference / "checkpoints/step-0000030.ckpt")
    load_weights(rounded, reference / "weights.safetensors")
    assert exact.stage == rounded.stage
    assert exact.stage.deformation
    assert exact.stage.articulation
    for name, value in tensors(exact).items():
        torch.testing.assert_close(tensors(rounded)[name], value, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["bank.num_slots=7"], r"expected bank.\w+ of shape \(7, .*got \(60, .*compose the same experiment"),
        (
            ["bank=single"],
            r"expected weights of the same model, got bank\.\w+ in the (file but not in the model|model but not)",
        ),
        (["deformation=none"], "got deformation.* in the file but not in the model"),
    ],
)
def test_other_models_weights_are_refused(reference, overrides, message):
    model = model_of(*overrides)
    before = {name: value.clone() for name, value in tensors(model).items()}
    with pytest.raises(FaunaError, match=message) as caught:
        load_weights(model, reference / "weights.safetensors")
    assert "\n" not in str(caught.value)
    assert_equal_bits(before, tensors(model))


def test_what_is_no_weight_file_is_refused(tmp_path):
    (tmp_path / "a.safetensors").write_bytes(b"x" * 40)
    (tmp_path / "b.ckpt").write_bytes(b"x" * 40)
    torch.save({"state_dict": {}}, tmp_path / "c.ckpt")
    for name in ("a.safetensors", "b.ckpt", "c.ckpt", "missing.ckpt"):
        with pytest.raises(FaunaError, match=name):
            read_weights(tmp_path / name)


def test_start_from_all_parts_of_other_weights(reference, tmp_path):
    weights = reference / "weights.safetensors"
    run(tmp_path, *tiny(f"init_from={weights}", "trainer.max_steps=1", "optimizer.lr=0", "optimizer.prior_lr=0"))
    assert same_bits(load_file(tmp_path / "weights.safetensors"), load_file(weights))
    assert state(tmp_path, 1)["global_step"] == 1


def test_start_from_some_parts_of_other_weights(reference, tmp_path):
    weights = reference / "weights.safetensors"
    still = ("trainer.max_steps=1", "optimizer.lr=0", "optimizer.prior_lr=0", "seed=5")
    run(tmp_path, *tiny(f"init_from={weights}", "init_components=[bank,shape]", *still))
    found, given = load_file(tmp_path / "weights.safetensors"), load_file(weights)
    taken = {name.split(".")[0] for name in found if torch.equal(found[name], given[name])}
    other = {name.split(".")[0] for name in found if not torch.equal(found[name], given[name])}
    assert taken >= {"bank", "shape", "feature_space"}
    assert not other & {"bank", "shape", "feature_space"}
    assert other >= {"embedder", "viewpoint", "articulation"}


def test_unknown_parts_are_named(reference, tmp_path):
    with pytest.raises(FaunaError, match=r"init_components: expected parts among .*'bank'.*got \['legs'\]"):
        run(tmp_path, *tiny(f"init_from={reference / 'weights.safetensors'}", "init_components=[legs]"))


@pytest.mark.parametrize("name", ["checkpoints/step-0000030.ckpt", "weights.safetensors"])
def test_evaluation_repeats_the_trainings_last_validation(reference, tmp_path, monkeypatch, name):
    few = ["size=32", "bootstrap=20", "baselines=[]", "pictures=1"]
    arguments = [f"checkpoint='{reference / name}'", f"out={tmp_path}/eval", *few]
    monkeypatch.setattr(sys, "argv", ["fauna-eval", *arguments])
    try:
        fauna.eval.main()
    finally:
        GlobalHydra.instance().clear()
    found = json.loads((tmp_path / "eval" / "report.json").read_text())["validation"]
    expected = json.loads((reference / "result.json").read_text())["trained"]
    exact = name.endswith(".ckpt")
    assert found["num_photos"] == expected["num_photos"] == 2
    assert found["iou"] == pytest.approx(expected["iou"], abs=1e-7 if exact else 0.02)
    assert set(found["species"]) == {"long", "round"}


# --- atomic writes ---------------------------------------------------------------------------------------------------


def fail(*args, **kwargs):
    raise OSError("disk full")


def test_failed_writes_leave_the_old_file(tmp_path, monkeypatch):
    model = model_of()
    path = tmp_path / "w.safetensors"
    save_weights(model, path, config=CONFIG, species=["dog", "horse"], half=True)
    before = path.read_bytes()
    monkeypatch.setattr(module, "save", fail)
    with pytest.raises(OSError, match="disk full"):
        save_weights(model, path, config=CONFIG, species=["dog", "horse"], half=True)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["w.safetensors"]


def test_json_that_cannot_be_written_leaves_nothing(tmp_path):
    with pytest.raises(TypeError):
        write_json({"tensor": object()}, tmp_path / "a" / "result.json")
    assert not (tmp_path / "a" / "result.json").exists()
    assert not list((tmp_path / "a").glob("*.partial"))


def test_picture_that_cannot_be_written_leaves_nothing(tmp_path, monkeypatch):
    picture = Image.new("RGB", (4, 4))
    monkeypatch.setattr(picture, "save", fail)
    with pytest.raises(OSError, match="disk full"):
        save_png(picture, tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()


def test_equal_weights_give_equal_files(tmp_path):
    """Also in another process, where texts would come in another order."""
    model = model_of()
    save_weights(model, tmp_path / "w.safetensors", config=CONFIG, species=["dog", "horse"], half=True)
    again = (
        "import sys; from pathlib import Path; from safetensors import safe_open; from safetensors.torch import load_file;"
        "from fauna.io.checkpoint import safetensors_bytes; path = Path(sys.argv[1]);"
        "metadata = safe_open(path, framework='pt').metadata();"
        "sys.exit(safetensors_bytes(load_file(path), metadata) != path.read_bytes())"
    )
    for _ in range(2):
        subprocess.run([sys.executable, "-c", again, str(tmp_path / "w.safetensors")], check=True, timeout=60)


# --- where a run starts from -----------------------------------------------------------------------------------------

ONE_STEP = ("trainer.max_steps=1", "optimizer.lr=0", "optimizer.prior_lr=0")


def test_a_folder_of_a_run_stands_for_its_weights(reference, tmp_path):
    run(tmp_path, *tiny(f"init_from={reference}", *ONE_STEP))
    assert same_bits(load_file(tmp_path / "weights.safetensors"), load_file(reference / "weights.safetensors"))
    (tmp_path / "empty").mkdir()
    with pytest.raises(FaunaError, match="^init_from: expected a run folder with weights.safetensors or checkpoints"):
        run(tmp_path / "x", *tiny(f"init_from={tmp_path / 'empty'}"))
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize("parts", [(), ("init_components=[viewpoint,mask_embedding]",)])
def test_features_are_read_as_the_weights_read_them(reference, tmp_path, parts):
    for key, value in (("whitening", "0.5"), ("standardize_tokens", "false")):
        with pytest.raises(
            FaunaError, match=f"^init_from: expected weights of the feature space .* with {key} "
        ) as caught:
            run(tmp_path, *tiny(f"init_from={reference}", *parts, f"feature_space.{key}={value}"))
        assert "\n" not in str(caught.value)
    run(tmp_path, *tiny(f"init_from={reference}", *parts, "feature_space.max_images=7", *ONE_STEP))


def test_viewpoints_do_not_depend_on_the_species_of_a_category_bank(reference, tmp_path):
    few = ("bank=category", "data.held_out=[round]")
    parts = "init_components=[viewpoint,mask_embedding]"
    run(tmp_path / "run", *tiny(f"init_from={reference}", parts, *few, *ONE_STEP))
    with pytest.raises(FaunaError, match="^init_from: expected weights of the same species"):
        run(tmp_path / "other", *tiny(f"init_from={reference}", "init_components=[bank]", *few))
