"""The whole table: perfect predictions, known errors, order, and what is missing."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fauna.errors import FaunaError
from fauna.metrics.keys import DEFINITIONS, definition
from fauna.metrics.score import SETTINGS, score, score_transfer
from fauna.metrics.transfer import transfer_canonical
from fauna.metrics.visibility import to_ndc
from tests.metrics.animals import NAMES, animal, camera, herd

OPTIONS = {"seed": 0, "pairs": 40, "bootstrap": 30}
FIXED = {"rings": 15, "around": 12, "length": 2.5, "height": 1.0}
ONE = ("iou", "kt_pck@0.1", "kt_pck@0.1_lr_free", "pck@0.1_fit_on_test", "f_score", "volume_iou", "novel_view_iou",
       "azimuth_within_30", "f_score_similarity", "volume_iou_similarity")  # fmt: skip
ZERO = ("chamfer", "leg_chamfer", "chamfer_similarity", "azimuth_error_deg", "elevation_error_deg", "front_back_flips",
        "left_right_flips", "global_flip")  # fmt: skip


@pytest.fixture(scope="module")
def flock():
    dogs, dog_samples = herd(6)
    cows, cow_samples = herd(5, "cow", seed=1)
    return dogs + cows, dog_samples + cow_samples


@pytest.fixture(scope="module")
def scores(flock):
    return score(*flock, **OPTIONS)


def reasons(result, name):
    return {row["metric"]: row["reason"] for row in result["left_out"] if row["name"] == name}


def turned(prediction, azimuth_deg, elevation_deg=5.0):
    view, clip = camera(azimuth_deg, elevation_deg)
    return replace(prediction, camera_from_world=view, clip_from_world=clip)


def test_perfect_predictions(scores):
    for key in ONE:
        assert scores["metrics"][key]["value"] == pytest.approx(1, abs=1e-9), key
    for key in ZERO:
        assert scores["metrics"][key]["value"] == pytest.approx(0, abs=1e-9), key
    assert scores["metrics"]["kt_pck@0.1"]["n"] == 11
    assert 20 < scores["metrics"]["kt_pck@0.1"]["pairs"] <= 50


def test_perfect_predictions_of_enough_photos_map_keypoints_exactly():
    result = score(*herd(24, **FIXED), **OPTIONS)
    assert result["metrics"]["pck@0.1"]["value"] == 1
    assert result["metrics"]["pa_mpjpe"]["value"] < 0.01
    assert result["metrics"]["pck@0.1"]["n"] == 12


def test_the_table_is_plain_and_complete(scores):
    json.dumps(scores, allow_nan=False)
    assert set(scores["species"]) == {"cow", "dog"}
    for species in scores["species"].values():
        assert set(species["metrics"]) == set(scores["metrics"]) - {"global_flip"}
        assert set(species["keypoints"]) == set(NAMES)
    for key, row in scores["metrics"].items():
        if key != "global_flip":
            assert row["low"] <= row["value"] + 1e-12
            assert row["high"] >= row["value"] - 1e-12
    counted = {
        key: sum(v[key] is not None for v in scores["images"].values())
        for key in scores["metrics"]
        if "flip" not in key
    }
    for key in ("iou", "chamfer", "azimuth_error_deg"):
        assert counted[key] == scores["metrics"][key]["n"] == 11


def test_order_changes_nothing(flock, scores):
    predictions, samples = flock
    rng = np.random.default_rng(0)
    shuffled = [predictions[i] for i in rng.permutation(11)], [samples[i] for i in rng.permutation(11)]
    assert json.dumps(score(*shuffled, **OPTIONS), sort_keys=True) == json.dumps(scores, sort_keys=True)


def test_stored_precision_is_enough(flock, scores):
    def stored(p):
        single = {
            name: getattr(p, name).astype(np.float32) for name in ("verts", "canonical", "local", "camera_from_world")
        }
        return replace(p, faces=p.faces.astype(np.int32), bone=p.bone.astype(np.int8), **single)

    found = score([stored(p) for p in flock[0]], flock[1], **OPTIONS)["metrics"]
    for key, row in scores["metrics"].items():
        assert found[key]["value"] == pytest.approx(row["value"], abs=0.02), key
        assert found[key]["n"] == row["n"], key


def test_photos_in_no_drawn_pair_are_named():
    predictions, samples = herd(8)
    result = score(predictions, samples, seed=0, pairs=2, bootstrap=0)
    missing = [row["name"] for row in result["left_out"] if row["reason"] == "in none of the drawn pairs"]
    assert result["metrics"]["kt_pck@0.1"]["pairs"] == 2
    assert len(missing) == 2 * (8 - result["metrics"]["kt_pck@0.1"]["n"])


def test_a_species_scores_the_same_alone(flock, scores):
    predictions, samples = flock
    alone = score(
        [p for p in predictions if p.category == "dog"], [s for s in samples if s.category == "dog"], **OPTIONS
    )
    assert alone["species"]["dog"] == scores["species"]["dog"]


def test_a_crop_beside_the_optical_axis_costs_nothing():
    """The truth's photo has the animal off its axis; a model sees the crop alone, from a camera of its own focal length and distance."""
    prediction, sample = animal("a", azimuth_deg=50.0)
    turn = Rotation.from_rotvec((4.0, -6.0, 0.0), degrees=True).as_matrix()
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = turn @ prediction.camera_from_world[:3, :3], turn @ prediction.camera_from_world[:3, 3]
    clip = prediction.clip_from_world @ np.linalg.inv(prediction.camera_from_world) @ view
    centre = to_ndc(clip, np.linalg.inv(prediction.camera_from_world)[None, :3, :] @ np.array([0.0, 0, -10, 1]))[0]
    cut = np.eye(4)
    cut[:2, 3] = -centre
    truth = replace(sample.truth, camera_from_world=view, clip_from_world=cut @ clip, azimuth_deg=0.0)
    rows = score([prediction], [replace(sample, truth=truth, keypoints=None)], **OPTIONS)["metrics"]
    for key in ("azimuth_error_deg", "elevation_error_deg"):
        assert rows[key]["value"] == pytest.approx(0, abs=1e-6), key
    assert rows["chamfer"]["value"] < 0.004  # 7 degrees off its axis the photo's scale differs by 1 %
    assert rows["novel_view_iou"]["value"] > 0.94


def test_known_errors(flock):
    predictions, samples = flock
    azimuths = {s.name: s.truth.azimuth_deg for s in samples}
    off = [turned(p, azimuths[p.name] + 40, 15.0) for p in predictions]
    rows = score(off, samples, **OPTIONS)["metrics"]
    assert rows["azimuth_error_deg"]["value"] == pytest.approx(40)
    assert rows["elevation_error_deg"]["value"] == pytest.approx(10)
    assert rows["azimuth_within_30"]["value"] == 0
    assert rows["chamfer"]["value"] > 0.02
    assert rows["chamfer_similarity"]["value"] < 0.3 * rows["chamfer"]["value"]
    assert rows["novel_view_iou"]["value"] < 0.9


def test_a_model_whose_head_is_the_tail_is_flipped_once(flock):
    predictions, samples = flock
    half_turn = np.diag([-1.0, 1.0, -1.0, 1.0])
    leg = np.r_[np.arange(8), 8 + (np.arange(12) + 6) % 12]

    def backwards(p):
        return replace(
            p, verts=p.verts @ half_turn[:3, :3], canonical=p.canonical @ half_turn[:3, :3], bone=leg[p.bone],
            camera_from_world=p.camera_from_world @ half_turn, clip_from_world=p.clip_from_world @ half_turn,
        )  # fmt: skip

    rows = score([backwards(p) for p in predictions], samples, **OPTIONS)["metrics"]
    assert rows["global_flip"]["value"] == 1
    for key in ("azimuth_error_deg", "leg_chamfer", "front_back_flips", "chamfer"):
        assert rows[key]["value"] == pytest.approx(0, abs=1e-9), key
    mixed = [backwards(p) if i % 4 == 0 else p for i, p in enumerate(predictions)]
    rows = score(mixed, samples, **OPTIONS)["metrics"]
    assert rows["global_flip"]["value"] == 0
    assert 0 < rows["front_back_flips"]["value"] < 0.5


def test_swapped_legs_are_leg_errors_only(flock):
    predictions, samples = flock
    leg = np.r_[np.arange(8), 8 + (np.arange(12) + 6) % 12]
    result = score([replace(p, bone=leg[p.bone]) for p in predictions], samples, **OPTIONS)["metrics"]
    assert result["leg_chamfer"]["value"] > 0.2
    assert result["chamfer"]["value"] < 1e-9


def test_shared_base_stands_beside_the_lookup():
    result = score(*herd(5, **FIXED), **OPTIONS, settings=("shared_base",))["metrics"]
    assert result["kt_pck@0.1_shared_base"] == result["kt_pck@0.1"]
    assert "kt_pck@0.1_shared_base_lr_free" in result
    assert "pck@0.1_fit_on_test" not in result


def test_shared_base_comes_from_predictions_of_its_own():
    """The lookup takes the one set of meshes, the vertex index the other; without equal triangles the reason is named."""
    predictions, samples = herd(5, **FIXED)
    broken = [replace(p, verts=np.full_like(p.verts, np.nan)) for p in predictions]
    result = score(broken, samples, **OPTIONS, settings=("shared_base",), shared=predictions)["metrics"]
    assert result["kt_pck@0.1"]["n"] == 0
    assert result["kt_pck@0.1_shared_base"]["n"] == 5
    different = score(*herd(3), **OPTIONS, settings=("shared_base",))
    assert different["metrics"]["kt_pck@0.1"]["n"] == 3
    assert different["metrics"]["kt_pck@0.1_shared_base"]["n"] == 0
    rows = [row for row in different["left_out"] if row["metric"] == "kt_pck@0.1_shared_base"]
    assert [row["reason"] for row in rows] == ["all photos: its species shares no base mesh"]


def test_every_key_has_a_definition(flock):
    result = score(*flock, **OPTIONS, settings=SETTINGS)
    assert {key for key in result["metrics"] if definition(key) is None} == set()
    assert {key for key in DEFINITIONS if key not in result["metrics"]} == set()


def test_whatever_cannot_be_scored_is_named(flock):
    predictions, samples = flock
    dogs, of_dogs = list(predictions[:6]), list(samples[:6])
    empty = replace(
        dogs[0], verts=np.zeros((0, 3)), canonical=np.zeros((0, 3)), local=np.zeros((0, 3)), bone=np.zeros(0, np.int64),
        faces=np.zeros((0, 3), np.int64), silhouette=np.zeros((64, 64), np.uint8),
    )  # fmt: skip
    broken = replace(dogs[1], verts=np.full_like(dogs[1].verts, np.nan))
    boneless = replace(dogs[2], bone=np.full(len(dogs[2].bone), -1), local=dogs[2].canonical)
    of_dogs[4] = replace(of_dogs[4], mask=None, truth=None, keypoints=None)
    result = score([empty, broken, boneless, *dogs[3:5]], of_dogs, **OPTIONS)
    json.dumps(result, allow_nan=False)
    assert set(reasons(result, dogs[0].name).values()) == {"empty mesh"}
    assert result["images"][dogs[0].name]["iou"] == 0
    assert set(reasons(result, dogs[1].name).values()) == {"prediction is not finite"}
    assert reasons(result, dogs[2].name)["leg_chamfer"] == "prediction has no bones"
    without = reasons(result, dogs[4].name)
    assert (without["iou"], without["chamfer"], without["kt_pck@0.1"]) == ("no mask", "no truth", "no keypoints")
    assert set(reasons(result, dogs[5].name).values()) == {"no prediction"}
    for name, row in result["images"].items():
        for key, value in row.items():
            assert (value is None) == (key in reasons(result, name) or "*" in reasons(result, name)), (name, key)


def test_a_dataset_without_annotation_says_so_once_per_metric(flock):
    predictions, samples = flock
    bare = [replace(s, keypoints=None, truth=None) for s in samples[:6]]
    result = score(predictions[:6], bare, **OPTIONS)
    assert result["metrics"]["iou"]["n"] == 6
    assert result["metrics"]["chamfer"] == {"value": None, "low": None, "high": None, "n": 0}
    assert result["metrics"]["kt_pck@0.1"]["n"] == 0
    assert reasons(result, "dog")["chamfer"] == "all photos: no truth"
    assert reasons(result, "dog")["kt_pck@0.1"] == "all photos: no keypoints"


def test_one_photo_of_a_species_has_no_pairs():
    prediction, sample = animal("a")
    result = score([prediction], [sample], **OPTIONS)
    assert result["metrics"]["kt_pck@0.1"] == {"value": None, "low": None, "high": None, "n": 0, "pairs": 0}
    assert reasons(result, "a")["kt_pck@0.1"] == "only photo of its species with keypoints"
    assert reasons(result, "a")["pck@0.1"] == "the keypoint map is fitted on it"
    assert result["metrics"]["chamfer"]["value"] < 1e-9


def test_photos_without_a_common_keypoint():
    (first, a), (second, b) = animal("a"), animal("b")
    flags = np.arange(len(NAMES)) < 3
    a = replace(a, keypoints=np.column_stack([a.keypoints[:, :2], flags]))
    b = replace(b, keypoints=np.column_stack([b.keypoints[:, :2], ~flags]))
    result = score([first, second], [a, b], **OPTIONS)
    assert result["metrics"]["kt_pck@0.1"]["value"] is None
    assert reasons(result, "dog")["kt_pck@0.1"] == "all photos: no keypoint annotated in both photos of a pair"


def test_nothing_at_all():
    assert score([], [], **OPTIONS)["metrics"] == {"global_flip": {"value": None, "low": None, "high": None, "n": 0}}


def test_a_function_is_scored_on_the_same_pairs(flock, scores):
    predictions, samples = flock
    order = np.random.default_rng(1).permutation(11)
    shuffled = [samples[i] for i in order]
    meshes = {p.name: p for p in predictions}

    def transfer(source, target):
        chosen = [shuffled[source], shuffled[target]]
        points = [np.where(s.keypoints[:, 2:] > 0, s.keypoints, 0.0) for s in chosen]
        return transfer_canonical([meshes[s.name] for s in chosen], points, np.array([[0, 1]]))[0]

    result = score_transfer(transfer, shuffled, **OPTIONS)
    for key in ("kt_pck@0.1", "kt_pck@0.1_lr_free"):
        assert result["metrics"][key] == scores["metrics"][key]
    nothing = score_transfer(lambda source, target: np.full((len(NAMES), 2), np.nan), shuffled, **OPTIONS)
    assert nothing["metrics"]["kt_pck@0.1"]["value"] == 0
    assert nothing["metrics"]["kt_pck@0.1"]["pairs"] == scores["metrics"]["kt_pck@0.1"]["pairs"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p, s: ([*p, p[0]], s), "expected predictions with unique names, got dog/000 more than once"),
        (lambda p, s: (p, [*s, s[0]]), "expected samples with unique names, got dog/000 more than once"),
        (lambda p, s: (p, s[1:]), "expected predictions of the samples, got one of dog/000; add its sample"),
        (lambda p, s: ([replace(p[0], category="cat")], s), "expected a prediction of dog for dog/000, got one of cat"),
        (
            lambda p, s: (p, [replace(s[0], mask=s[0].mask[:32, :32]), *s[1:]]),
            "expected a mask of 64 pixels for dog/000",
        ),
        (lambda p, s: (p, [replace(s[0], keypoints=s[0].keypoints[:3]), *s[1:]]), "expected 11 keypoints for dog/000"),
        (
            lambda p, s: (p, [replace(s[0], keypoint_names=NAMES[::-1]), *s[1:]]),
            "expected equal keypoint names within dog",
        ),
    ],
)
def test_what_does_not_fit_is_an_error(flock, change, message):
    with pytest.raises(FaunaError, match=message):
        score(*change(flock[0][:2], flock[1][:2]), **OPTIONS)


def test_unknown_settings_are_named(flock):
    with pytest.raises(FaunaError, match="settings: expected names among shared_base, .* got 'shared'"):
        score(*flock, **OPTIONS, settings=("shared",))
