import json

import numpy as np
import pytest
from PIL import Image

from fauna.errors import FaunaError
from fauna.evaluation.conditions import CONDITIONS, compare, describe, markdown

CUT, TALL, PAWS, FACE, BEHIND = CONDITIONS
NAMES = ["left_eye", "right_eye", "nose", "left_front_paw", "right_front_paw", "left_back_paw", "tailbase"]


def crop(folder, stem, box, window, seen):
    folder.mkdir(parents=True, exist_ok=True)
    mask = np.zeros((100, 100), np.uint8)
    left, top, right, bottom = box
    mask[top:bottom, left:right] = 255
    Image.fromarray(mask).save(folder / f"{stem}_mask.png")
    Image.new("RGB", (100, 100)).save(folder / f"{stem}_rgb.jpg")
    (folder / f"{stem}_box.txt").write_text(f"0 {window} 200 100 0\n")
    points = [[1.0, 1.0, float(name in seen)] for name in NAMES]
    (folder / f"{stem}_keypoints.json").write_text(json.dumps({"keypoints": points}))


@pytest.fixture
def root(tmp_path):
    (tmp_path / "keypoint_names.json").write_text(json.dumps({"keypoint_names": NAMES}))
    cat = tmp_path / "cat" / "test"
    crop(cat, "wide", (10, 40, 90, 60), "50 0 100 100", NAMES)
    crop(cat, "tall", (45, 5, 60, 95), "50 0 100 100", ["tailbase", "left_front_paw"])
    crop(cat, "edge", (30, 40, 90, 60), "-30 0 100 100", NAMES)  # the photograph begins where the animal does
    crop(cat, "free", (40, 40, 90, 60), "-30 0 100 100", NAMES[2:])
    return tmp_path


def test_what_a_photograph_is_like(root):
    found = describe(root)
    told = {name.split("/")[-1]: answers for name, answers in found.items()}
    assert [told[name][CUT] for name in ("wide", "tall", "edge", "free")] == [False, False, True, False]
    assert [told[name][TALL] for name in ("wide", "tall", "edge", "free")] == [False, True, False, False]
    assert [told[name][PAWS] for name in ("wide", "tall")] == [False, True]
    assert [told[name][FACE] for name in ("wide", "tall", "free")] == [True, False, False]
    assert [told[name][BEHIND] for name in ("wide", "tall", "free")] == [False, True, False]


def test_differences_are_within_species(tmp_path):
    described, images = {}, {}
    for species, level in (("cat", 0.9), ("dog", 0.5)):
        for index in range(8):
            name = f"{species}/{index}"
            is_so = index < (6 if species == "cat" else 3)  # most cats, few dogs
            described[name] = {title: is_so for title in CONDITIONS}
            images[name] = {
                "species": species,
                "scores": {"iou": level - 0.1 * is_so, "kt_pck@0.1": None},
                "baselines": {"feature_matching": {"kt_pck@0.1": 0.2 + 0.3 * is_so}},
            }
    (tmp_path / "images.json").write_text(json.dumps({"metrics": images}))
    rows = compare(tmp_path, described)
    assert {(row["of"], row["metric"]) for row in rows} == {("model", "iou"), ("feature_matching", "kt_pck@0.1")}
    assert rows[1]["difference"] == pytest.approx(0.3)
    dogs_only = rows[0]  # two cats are too few
    assert dogs_only["n"] == (3, 5)
    assert dogs_only["difference"] == pytest.approx(-0.1)
    assert dogs_only["low"] == pytest.approx(-0.1)
    assert "-0.100" in markdown(tmp_path, rows)
    with pytest.raises(FaunaError, match="without any of them"):
        compare(tmp_path, {})


GOOD = {"species": "cat", "scores": {"iou": 0.5}, "baselines": {"box_copy": {"iou": 0.1}}}
DAMAGED = [
    {"species": ["cat"]},
    {"species": None},
    {"scores": None},
    {"scores": [0.5]},
    {"scores": {"iou": "x"}},
    {"scores": {"iou": float("nan")}},
    {"baselines": None},
    {"baselines": [1]},
    {"baselines": {"box_copy": None}},
    {"baselines": {"box_copy": [1]}},
]


@pytest.mark.parametrize(
    "content",
    [
        None,
        "{",
        "[]",
        '{"metrics": []}',
        '{"metrics": {"cat/1": 3}}',
        *(json.dumps({"metrics": {"cat/1": GOOD | damage}}) for damage in DAMAGED),
    ],
)
def test_what_is_no_report_is_named(tmp_path, content):
    if content is not None:
        (tmp_path / "images.json").write_text(content)
    with pytest.raises(FaunaError, match="^expected the folder of a fauna-eval report .* score again with") as caught:
        compare(tmp_path, {"cat/1": dict.fromkeys(CONDITIONS, True)})
    assert "\n" not in str(caught.value)


def test_a_report_from_before_baselines_by_photograph_has_rows_of_the_model_only(tmp_path):
    """And a baseline that is called like the model does not take its place."""
    rows = {f"cat/{index}": GOOD | {"baselines": {"model": {"iou": 0.0}}} for index in range(4)}
    rows |= {f"cat/{index}": {"species": "cat", "scores": {"iou": 0.5}} for index in range(4, 8)}
    (tmp_path / "images.json").write_text(json.dumps({"metrics": rows}))
    found = compare(tmp_path, {name: dict.fromkeys(CONDITIONS, name < "cat/4") for name in rows})
    assert {(row["of"], row["yes"], row["no"]) for row in found} == {("model", 0.5, 0.5)}
