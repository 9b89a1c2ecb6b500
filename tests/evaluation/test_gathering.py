"""What a predictions folder goes through: it grows, photographs change or lack files, keypoints have no names, bases are shared."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir

import fauna.evaluation.stopwatch as stopwatch
from fauna._conf import CONF_DIR
from fauna.build import build_encoder, build_model
from fauna.errors import FaunaError
from fauna.eval import evaluate
from fauna.evaluation.reading import read_predictions
from fauna.evaluation.shared_base import answering
from fauna.evaluation.stopwatch import Stopwatch
from tests.runs import composed, draw_dataset, reference_run, tiny

NAMES = ("nose", "left_paw", "right_paw", "tailbase")
FAST = ("size=32", "pairs=50", "bootstrap=20", "threads=1", "pictures=1", "baselines=[]", "settings=[]")


def evaluated(root: Path, out: Path, *overrides: str) -> dict:
    words = (f"checkpoint='{reference_run()}'", f"data.root='{root}'", "data=fauna", *FAST, *overrides)
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        cfg = compose("eval", overrides=list(words))
    return evaluate(cfg, out)


@pytest.fixture
def root(tmp_path) -> Path:
    """Six photographs with four named keypoints each."""
    folder = draw_dataset(tmp_path / "data", train=3, val=0)
    for index, image in enumerate(sorted(folder.rglob("*_rgb.png"))):
        points = [[6 + index, 10, 1], [10, 24, 1], [20, 24, 1], [27 - index, 9, 1]]
        path = image.with_name(image.name.replace("rgb.png", "keypoints.json"))
        path.write_text(json.dumps({"keypoints": points}))
    (folder / "keypoint_names.json").write_text(json.dumps({"keypoint_names": NAMES}))
    return folder


def left_out(report: dict, words: str) -> list[dict]:
    return [row for row in report["left_out"] if words in row["reason"]]


def comparable(report: dict) -> dict:
    return {key: value for key, value in json.loads(json.dumps(report)).items() if key != "timing"}


ALL_THERE_IS = (
    "baselines=[box_copy,mean_shape,feature_matching,untrained]",
    "settings=[shared_base]",
    "probes=[camera]",
)
MUCH = (*ALL_THERE_IS, "probe_steps=1", "probe_photos=3")


def test_a_folder_that_grows_and_shrinks_gives_the_reports_of_new_folders(root, tmp_path):
    for number in (2, 5, 3):
        limit = f"max_photos={number}"
        grown = evaluated(root, tmp_path / "grown", limit, *MUCH)
        assert grown["metrics"]["iou"]["n"] == number
        fresh = evaluated(root, tmp_path / f"fresh-{number}", limit, *MUCH)
        assert comparable(grown) == comparable(fresh)


def test_one_base_mesh_per_species_makes_vertex_indices_correspond(root, tmp_path):
    report = evaluated(root, tmp_path / "out", *MUCH)
    assert report["metrics"]["kt_pck@0.1_shared_base"]["n"] == 6
    assert report["metrics"]["kt_pck@0.1"]["n"] == 6
    by_species: dict[str, list] = {}
    for prediction in read_predictions(tmp_path / "out" / "predictions", "shared_base"):
        by_species.setdefault(prediction.category, []).append(prediction)
    assert set(by_species) == {"long", "round"}
    for predictions in by_species.values():
        first, *others = predictions
        for other in others:
            np.testing.assert_array_equal(other.canonical, first.canonical)
            np.testing.assert_array_equal(other.faces, first.faces)
            assert np.abs(other.verts - first.verts).max() > 1e-4  # posed for its own photograph
    assert report["baselines"]["mean_shape"]["metrics"]["kt_pck@0.1_shared_base"]["n"] == 6
    again = tmp_path / "without"
    shutil.copytree(tmp_path / "out" / "predictions", again / "predictions")
    shutil.rmtree(again / "predictions" / "shared_base")
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        cfg = compose("eval", overrides=[f"predictions='{again}/predictions'", *FAST, "settings=[shared_base]"])
    report = evaluate(cfg, again)
    assert report["metrics"]["kt_pck@0.1_shared_base"]["n"] == 0
    assert left_out(report, "evaluate the checkpoint with settings=[shared_base]")


def test_the_model_keeps_its_bank():
    cfg = composed(*tiny())
    model = build_model(cfg, build_encoder(cfg))
    own = model.bank
    with pytest.raises(RuntimeError, match="stop"), answering(model, torch.zeros(own.value_dim)):
        _fail_inside(model, own)
    assert model.bank is own


def _fail_inside(model, own):
    assert model.bank is not own
    raise RuntimeError("stop")


def test_what_a_probe_leaves_out_is_said(root, tmp_path):
    report = evaluated(root, tmp_path, *MUCH, "max_photos=2")  # one photograph of each species: no pairs
    rows = [row for row in report["left_out"] if row["of"] == "probe camera"]
    assert any("kt_pck@0.1" in row["metrics"] and "only photo of its species" in row["reason"] for row in rows)
    assert any(row["of"] == "the model on the photographs of probe camera" for row in report["left_out"])


def test_a_missing_mask_leaves_one_photograph_out(root, tmp_path):
    (root / "long" / "train" / "a_mask.png").unlink()
    report = evaluated(root, tmp_path / "out")
    assert report["metrics"]["iou"]["n"] == 5
    (row,) = left_out(report, "a_mask.png expects an image file, got nothing there")
    assert (row["count"], row["names"]) == (1, ["data/long/train/a"])


def test_keypoints_without_names_cost_keypoint_metrics_only(root, tmp_path):
    (root / "keypoint_names.json").unlink()
    report = evaluated(root, tmp_path / "out")
    assert report["metrics"]["iou"]["n"] == 6
    assert report["metrics"]["kt_pck@0.1"]["n"] == 0
    (row,) = left_out(report, "keypoint_names.json")
    assert (row["metrics"], row["count"]) == (["keypoint metrics"], 6)
    assert not left_out(report, "the dataset has no keypoints")
    assert comparable(evaluated(root, tmp_path / "out")) == comparable(report)  # also when nothing is read again


def test_a_photograph_that_changed_is_not_mixed_with_what_was_stored(root, tmp_path):
    evaluated(root, tmp_path / "out")
    shutil.copy(root / "long" / "train" / "b_mask.png", root / "long" / "train" / "a_mask.png")
    with pytest.raises(FaunaError, match="another picture or annotation of data/long/train/a; choose another out"):
        evaluated(root, tmp_path / "out")


def test_seconds_add_up_over_interruptions(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(stopwatch.time, "monotonic", lambda: now[0])

    def interrupted():
        with Stopwatch(tmp_path / "timing.json").part("model"):
            now[0] += 30
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    killed = Stopwatch(tmp_path / "timing.json")
    with killed.part("model"):
        now[0] += 20
        killed.tick()
        now[0] += 5  # not stored yet when the process is killed
        third = Stopwatch(tmp_path / "timing.json")
    with third.part("model"):
        now[0] += 7
    with third.part("untrained"):
        now[0] += 1
    assert third.rounded() == {"model": 57.0, "untrained": 1.0}
    (tmp_path / "timing.json").write_text("[broken")
    assert Stopwatch(tmp_path / "timing.json").rounded() == {}
