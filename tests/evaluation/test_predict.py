"""Predictions of a small model, end to end: command, resuming, scoring again without the model, baselines, probes."""

import json
import shutil
import sys

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir

import fauna.eval
import fauna.evaluation.gather as gather
from fauna._conf import CONF_DIR
from fauna.build import build_encoder, build_model
from fauna.errors import FaunaError
from fauna.eval import evaluate
from fauna.evaluation.arguments import check
from fauna.evaluation.baselines import available
from fauna.evaluation.baselines.box_copy import mask_box
from fauna.evaluation.baselines.feature_matching import describe
from fauna.evaluation.predict import bone_coordinates, predict
from fauna.evaluation.probes import ProbeOptions, fit
from fauna.evaluation.store import ArrayStore
from fauna.geometry.skinning import rest_frames
from fauna.io.checkpoint import load_weights
from fauna.metrics.sample import Sample
from tests.pretrained.objects import publishable
from tests.runs import composed, dataset, reference_run, tiny

FAST = ("size=32", "pairs=50", "bootstrap=20", "threads=1", "baselines=[box_copy,mean_shape]", "pictures=1")


def configured(*overrides: str):
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return compose("eval", overrides=list(overrides))


@pytest.fixture(scope="module")
def run():
    return reference_run()


@pytest.fixture(scope="module")
def evaluated(run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("evaluated")
    report = evaluate(configured(f"checkpoint='{run}'", *FAST, "baselines=[box_copy,mean_shape,untrained]"), folder)
    return folder, report


@pytest.fixture(scope="module")
def model(run):
    cfg = composed(*tiny())
    model = build_model(cfg, build_encoder(cfg))
    load_weights(model, run / "weights.safetensors")
    return model.eval()


@pytest.fixture(scope="module")
def photo(model):
    from hydra.utils import instantiate

    cfg = composed(*tiny())
    data = instantiate(cfg.data, _convert_="all", _partial_=True)(encoder=model.encoder)
    data.prepare(seed=0, report=lambda line: None)
    return data.single(data.photos("val")[0])


def comparable(report: dict) -> dict:
    return {key: value for key, value in json.loads(json.dumps(report)).items() if key != "timing"}


# --- one photo -------------------------------------------------------------------------------------------------------


def test_prediction_is_what_the_model_says(model, photo):
    prediction, out = predict(model, photo, category="long", size=64)
    np.testing.assert_array_equal(prediction.verts, out.posed.verts[0].detach().numpy())
    np.testing.assert_array_equal(prediction.faces, out.posed.faces.numpy())
    assert prediction.silhouette.shape == (64, 64)
    assert prediction.silhouette.max() == 255
    chosen = int(out.hypotheses.predicted_losses[0].argmin())
    np.testing.assert_allclose(prediction.forwards[chosen], prediction.camera_from_world[:3, 2], atol=1e-6)
    assert prediction.probabilities.sum() == pytest.approx(1.0, abs=1e-5)
    assert prediction.angles.shape == (20, 3)


def test_silhouette_at_the_batchs_size_is_the_rendered_one(model, photo):
    prediction, out = predict(model, photo, category="long", size=photo.images.shape[-1])
    expected = (out.renders.silhouette[0].numpy() * 255).round()
    np.testing.assert_allclose(prediction.silhouette, expected, atol=1)


def test_bone_coordinates_lead_back_to_the_vertices(model, photo):
    """start + length (along f + right r + up u) is the rest position, for each vertex in its strongest bone's frame."""
    out = model(photo)
    rest = out.instance.verts[:1]
    place = bone_coordinates(model.rig, rest, out.base.verts, out.skeleton)
    starts, ends = out.skeleton.starts[0].numpy(), out.skeleton.ends[0].numpy()
    frames = rest_frames(out.skeleton)[0].numpy()
    for vertex in range(0, len(place.bone), 17):
        bone = place.bone[vertex]
        right, up, forward = frames[bone].T
        length = np.linalg.norm(ends[bone] - starts[bone])
        along, to_right, upwards = place.local[vertex]
        found = starts[bone] + length * (along * forward + to_right * right + upwards * up)
        np.testing.assert_allclose(found, rest[0, vertex].detach().numpy(), atol=1e-4)


def test_without_a_skeleton_the_base_shape_stands_in(model, photo):
    out = model(photo)
    place = bone_coordinates(model.rig, out.instance.verts[:1], out.base.verts, None)
    assert set(place.bone) == {-1}
    np.testing.assert_array_equal(place.local, out.base.verts.detach().numpy())


def test_only_single_photos_are_predicted(model, photo):
    both = type(photo)(**{**vars(photo), "names": ("a", "b")})
    with pytest.raises(FaunaError, match="batch of one photo, got 2"):
        predict(model, both, category="long", size=32)


# --- the command -----------------------------------------------------------------------------------------------------


def test_report_of_a_run(evaluated, run):
    folder, report = evaluated
    assert report["protocol"]["split"] == "val"  # the drawn dataset has no test photos
    assert report["protocol"]["checkpoint"]["step"] == 30
    assert report["metrics"]["iou"]["n"] == 2
    assert set(report["species"]) == {"long", "round"}
    assert set(report["baselines"]) == {"box_copy", "mean_shape", "untrained"}
    assert set(report["timing"]) >= {"samples", "model", "untrained", "score model"}
    for name in ("report.json", "report.md", "report.html", "images.json", "predictions/facts.json"):
        assert (folder / name).is_file(), name
    rows = json.loads((folder / "images.json").read_text())["metrics"].values()
    untrained = np.mean([row["baselines"]["untrained"]["iou"] for row in rows])  # one photograph of each species
    assert untrained == pytest.approx(report["baselines"]["untrained"]["metrics"]["iou"]["value"])
    trained = json.loads((run / "result.json").read_text())["trained"]
    assert report["validation"]["iou"] == pytest.approx(
        trained["iou"], abs=0.02
    )  # weights are rounded to half precision


def test_stored_predictions_give_the_same_report_without_the_model(evaluated, tmp_path, monkeypatch):
    folder, report = evaluated
    for name in ("fauna.build.build_model", "fauna.build.build_encoder", "fauna.io.checkpoint.load_weights"):
        monkeypatch.setattr(name, None)
    again = evaluate(configured(f"predictions='{folder}/predictions'", *FAST), tmp_path)
    assert comparable(again) == comparable(report)


def test_all_photographs_of_a_named_folder_whatever_their_split(run, tmp_path):
    overrides = ["data=fauna", f"data.root='{dataset()}'", "baselines=[]"]
    report = evaluate(configured(f"checkpoint='{run}'", *FAST, *overrides), tmp_path)
    assert report["protocol"]["split"] == "all"
    assert report["metrics"]["iou"]["n"] == 10
    assert report["protocol"]["dataset"]["training_photos"] == {"included": 8, "left_out": 0, "unknown": None}
    assert "8 of the photographs are of those the checkpoint was trained on" in (tmp_path / "report.html").read_text()


def test_interrupted_evaluation_continues(run, evaluated, tmp_path, monkeypatch):
    monkeypatch.setattr("fauna.evaluation.store.SHARD_SIZE", 1)
    options = (f"checkpoint='{run}'", *FAST, "baselines=[box_copy,mean_shape,untrained]")
    counted = []
    original = gather.predict

    def dies_at_second(*arguments, **keys):
        counted.append(1)
        if len(counted) == 2:
            raise KeyboardInterrupt
        return original(*arguments, **keys)

    monkeypatch.setattr(gather, "predict", dies_at_second)
    with pytest.raises(KeyboardInterrupt):
        evaluate(configured(*options), tmp_path)
    assert ArrayStore(tmp_path / "predictions" / "model", identity=None).names.__len__() == 1
    report = evaluate(configured(*options), tmp_path)
    assert len(counted) == 3
    assert comparable(report) == comparable(evaluated[1])


def test_a_broken_photograph_is_left_out_by_name(run, tmp_path):
    root = tmp_path / "data"
    shutil.copytree(dataset(), root)
    (root / "long" / "train" / "a_mask.png").write_bytes(b"broken")
    overrides = ["data=fauna", f"data.root='{root}'", "baselines=[]"]
    report = evaluate(configured(f"checkpoint='{run}'", *FAST, *overrides), tmp_path / "out")
    row = next(row for row in report["left_out"] if row["metrics"] == ["all"])
    assert row["count"] == 1
    assert row["names"][0].endswith("long/train/a")
    assert "a_mask.png expects a readable image" in row["reason"]
    assert report["metrics"]["iou"]["n"] == 9


def test_a_photograph_the_model_fails_on_is_left_out_by_name(run, tmp_path, monkeypatch):
    original = gather.predict

    def fails(model, photo, **keys):
        if "long" in photo.names[0]:
            raise FaunaError("expected a surface, got none; train longer")
        return original(model, photo, **keys)

    monkeypatch.setattr(gather, "predict", fails)
    report = evaluate(configured(f"checkpoint='{run}'", *FAST), tmp_path)
    rows = {tuple(row["names"]): row["reason"] for row in report["left_out"] if row["metrics"] == ["all"]}
    assert list(rows.values()) == ["expected a surface, got none; train longer"]
    assert report["metrics"]["iou"]["n"] == 1
    assert report["baselines"]["mean_shape"]["metrics"]["iou"]["n"] == 1


def test_probes_are_marked(run, tmp_path):
    overrides = ["probes=[camera]", "probe_steps=3", "probe_photos=1", "baselines=[]"]
    report = evaluate(configured(f"checkpoint='{run}'", *FAST, *overrides), tmp_path)
    probe = report["probes"]["camera"]
    assert probe["label"].startswith("not feed-forward")
    assert probe["num_photos"] == 1
    assert "iou" in probe["metrics"]
    assert "iou" in probe["model_on_the_same_photos"]
    assert "not feed-forward" in (tmp_path / "report.md").read_text()


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ([], "either checkpoint=PATH or predictions=DIR, got neither"),
        (["checkpoint=a", "predictions=b"], "got both"),
        (["checkpoint=/nowhere/at/all"], "does not exist"),
        (["checkpoint=/"], "run folder"),
        (["checkpoint=a", "data.split=vla"], "data.split: expected one of all, train"),
        (["checkpoint=a", "baselines=[magic]"], "baselines: expected names among .*box_copy"),
        (["checkpoint=a", "probes=[legs]"], "probes: expected names among angles"),
        (["checkpoint=a", "settings=[magic]"], "settings: expected names among shared_base"),
        (["checkpoint=a", "pairs=0"], "pairs: expected"),
        (["checkpoint=a", "pairs=many"], "pairs: expected a whole number"),
        (["predictions=/nowhere/at/all"], "finished predictions folder"),
        (["predictions=123"], "finished predictions folder"),
        (["checkpoint=7"], "got 7, which does not exist"),
        (["checkpoint=[7]"], "checkpoint: expected text or a whole number or null"),
        (["checkpoint=a", "seed=abc"], "seed: expected a whole number, got 'abc'"),
        (["checkpoint=a", "seed=1.5"], "seed: expected a whole number, got 1.5"),
        (["checkpoint=a", "seed=-1"], "seed: expected a number from 0"),
        (["checkpoint=a", "probe_lr=fast"], "probe_lr: expected a number, got 'fast'"),
        (["checkpoint=a", "baselines=null"], r"baselines: expected a list of names, got null; e.g. baselines=\[\]"),
        (["checkpoint=a", "settings=null"], "settings: expected a list of names, got null"),
        (["checkpoint=a", "probes=null"], "probes: expected a list of names, got null"),
        (["checkpoint=a", "probes=[[camera]]"], "probes: expected a list of names"),
        (["checkpoint=a", "settings=[tilted]"], "settings: expected names among .*similarity, got 'tilted'"),
        (["checkpoint=a", "baselines=box_cpy"], "got 'box_cpy'"),
        (["checkpoint=a", "out="], "out: expected a folder"),
    ],
)
def test_what_cannot_work_is_said_in_one_line(overrides, words, tmp_path):
    with pytest.raises(FaunaError, match=words) as caught:
        evaluate(configured(*overrides), tmp_path)
    assert "\n" not in str(caught.value)


def test_a_single_name_stands_for_a_list_of_one():
    cfg = configured("checkpoint=a", "baselines=box_copy", "probes=camera", "settings=similarity")
    check(cfg)
    assert (cfg.baselines, cfg.probes, cfg.settings) == (["box_copy"], ["camera"], ["similarity"])


def test_wrong_values_of_the_dataset_are_refused_before_it_is_read(run, tmp_path):
    for override, words in (
        ("data.root=7", "data.root: expected text"),
        ("data.held_out=7", "data.held_out: expected"),
    ):
        with pytest.raises(FaunaError, match=words):
            evaluate(configured(f"checkpoint='{run}'", *FAST, "data=fauna", override), tmp_path)


def test_stored_transfers_of_other_photographs_are_made_again(run, tmp_path):
    """The same ``out`` with more photographs, and after damage."""
    options = (f"checkpoint='{run}'", *FAST, "baselines=[box_copy]", "data=fauna", f"data.root='{dataset()}'")
    evaluate(configured(*options, "max_photos=2"), tmp_path)
    report = evaluate(configured(*options), tmp_path)
    assert report["metrics"]["iou"]["n"] == 10
    assert not [row for row in report["left_out"] if row["of"] == "box_copy" and "stored" in row["reason"]]
    (tmp_path / "predictions" / "box_copy.npz").write_bytes(b"PK\x03\x04 damaged")
    again = evaluate(configured(*options), tmp_path)
    assert comparable(again) == comparable(report)


def test_another_checkpoint_is_not_mixed_in(run, evaluated, tmp_path):
    shutil.copytree(evaluated[0], tmp_path / "out")
    other = run / "checkpoints" / "step-0000020.ckpt"
    with pytest.raises(FaunaError, match="choose another out"):
        evaluate(configured(f"checkpoint='{other}'", *FAST), tmp_path / "out")


def test_words_before_hydra(monkeypatch, capsys):
    for word in ("compare", "table"):
        monkeypatch.setattr(sys, "argv", ["fauna-eval", word, "--help"])
        fauna.eval.main()
        assert f"usage: fauna-eval {word}" in capsys.readouterr().out


# --- baselines and probes --------------------------------------------------------------------------------------------


def sample(mask: np.ndarray, keypoints: np.ndarray) -> Sample:
    return Sample("a", "dog", mask, keypoints.astype(np.float32), tuple(f"k{i}" for i in range(len(keypoints))), None)


def test_baselines_are_found_by_file():
    assert set(available()) >= {"feature_matching", "box_copy", "mean_shape", "untrained"}


def test_mask_box_is_the_masks_box():
    mask = np.zeros((8, 8), bool)
    mask[2:4, 1:7] = True
    low, high = mask_box(sample(mask, np.zeros((0, 3))))
    np.testing.assert_allclose(low, [-0.75, -0.5])
    np.testing.assert_allclose(high, [0.75, 0.0])


def test_features_are_taken_at_keypoints_and_searched_inside_the_mask():
    grid = 4
    tokens = torch.eye(grid * grid).reshape(grid * grid, grid, grid)  # each cell its own direction
    mask = np.zeros((8, 8), bool)
    mask[:, 4:] = True
    centre = [(2 * 2 + 1) / grid - 1, (2 * 1 + 1) / grid - 1]  # column 2, row 1
    found = describe(tokens, sample(mask, np.array([[*centre, 1.0]])))
    assert int(found.keypoints[0].argmax()) == 1 * grid + 2
    assert len(found.cells) == 8
    assert (found.places[:, 0] > 0).all()
    place = found.places[int((found.keypoints @ found.cells.T).argmax())]
    np.testing.assert_allclose(place, centre)


def test_box_copy_and_the_mean_shape_are_scored(evaluated):
    baselines = evaluated[1]["baselines"]
    assert baselines["mean_shape"]["metrics"]["iou"]["n"] == 2
    assert 0 <= baselines["untrained"]["metrics"]["iou"]["value"] <= 1
    assert all(row["description"] for row in baselines.values())


@pytest.mark.parametrize("free", ["angles", "camera", "both"])
def test_probe_lowers_the_mask_error_and_keeps_what_is_not_free(model, photo, free):
    with torch.no_grad():
        start = model(photo)
    out = fit(model, photo, free, ProbeOptions(steps=12, lr=0.05))

    def error(posed, camera):
        from fauna.renderer.deferred import render_silhouette

        return float((render_silhouette(model.renderer, posed, camera, (32, 32)) - photo.masks).square().mean())

    assert error(out.posed, out.camera) < error(start.posed, start.camera)
    torch.testing.assert_close(out.base.verts, start.base.verts, rtol=0, atol=0)
    same_camera = torch.equal(out.camera.clip_from_world, start.camera.clip_from_world)
    same_pose = torch.equal(out.pose.angles, start.pose.angles)
    assert same_camera == (free == "angles")
    assert same_pose == (free == "camera")
    limits = model.articulation.limits(model.stage.leg_limits)
    assert (out.pose.angles.abs() <= limits + 1e-6).all()
    assert float(limits.min()) == 0.0
    rotation = out.camera.camera_from_world[0, :3, :3]
    torch.testing.assert_close(rotation @ rotation.T, torch.eye(3), atol=1e-5, rtol=0)


def test_the_trainings_dataset_may_be_elsewhere(tmp_path):
    """One line that says what to add; what the command line names itself is spoken of as it is."""
    weights = publishable(
        tmp_path / "run",
        source={"_target_": "fauna.data.sources.FaunaFolder", "root": None, "photograph_pattern": "(.+)"},
    )
    with pytest.raises(
        FaunaError, match=r"^data: expected a dataset, .* add data=zoo, or data=fauna data\.root=FOLDER"
    ) as caught:
        evaluate(configured(f"checkpoint={weights}", *FAST), tmp_path / "out")
    assert "\n" not in str(caught.value)
    with pytest.raises(Exception, match=r"data\.root: expected a dataset folder"):
        evaluate(configured(f"checkpoint={weights}", "data=fauna", *FAST), tmp_path / "out")
