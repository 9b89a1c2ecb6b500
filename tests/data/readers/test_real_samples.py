"""The published files themselves, where they are at hand (FAUNA_TEST_DATA): what was seen once by eye stays so."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from fauna.data.readers.stanfordextra import StanfordExtraPhotos
from fauna.data.sources import FaunaFolder
from fauna.zoo.body import KEYPOINTS
from tests.data.readers.fixtures import coco

DATA = Path(os.environ.get("FAUNA_TEST_DATA", "nowhere"))
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="FAUNA_TEST_DATA names no folder of samples")
SAMPLES = {
    "ap10k": ({}, {"antelope": 1, "jaguar": 1}, 17),
    "animalpose": ({}, {"cat": 2}, 20),
    "atrw": ({}, {"tiger": 2}, 15),
    "horse10": ({}, {"horse": 3}, 22),
    "zebra": ({}, {"zebra": 2}, 9),
    "ak": ({"species_field": "animal", "photograph_pattern": "(.+)/[^/]+"}, {"elephant": 2}, 23),
}


def photos(collection) -> list:
    return [photo for each in collection.categories().values() for photo in each.train]


@needs_data
@pytest.mark.parametrize("name", SAMPLES)
def test_coco_samples(name):
    options, species, keys = SAMPLES[name]
    folder = DATA / "raw" / "format_samples" / name
    (file,) = folder.glob("*.json")
    collection = coco(folder, annotations=file.name, images=".", crop_size=128, box_margin=0.15, **options)
    assert {each: len(found.train) for each, found in collection.categories().items()} == species
    assert collection.left_out == ()
    assert len(set(collection.keypoint_names)) == keys
    for photo in photos(collection):
        raw = photo.source.read()
        assert raw.mask_source == "box"
        known = raw.keypoints[raw.keypoints[:, 2] > 0, :2]
        assert len(known) >= 5
        assert np.mean((known > -2) & (known < 130)) > 0.97


@needs_data
def test_a_tiger_seen_from_its_left():
    """It walks to the left of the picture, so its left front paw is the lower one and its nose lies left of the tail."""
    folder = DATA / "raw" / "format_samples" / "atrw"
    collection = coco(folder, annotations="test_atrw.json", images=".", crop_size=256)
    (photo,) = [photo for photo in photos(collection) if photo.name.endswith("/3464")]
    points = dict(zip(collection.keypoint_names, photo.source.read().keypoints, strict=True))
    assert points["nose"][0] < points["tailbase"][0]
    assert points["left_front_paw"][1] > points["right_front_paw"][1]
    assert points["left_front_paw"][1] > points["left_front_elbow"][1] > points["tailbase"][1]


@needs_data
def test_uncropped_animal_pose_agrees_with_its_crops():
    """Same keypoints as in the crops that were made from these photographs elsewhere, by the same rule."""
    collection = coco(DATA / "raw" / "animalpose", annotations="annotations.json", images=".", crop_size=256)
    assert collection.keypoint_names == KEYPOINTS
    items = json.loads((DATA / "raw" / "animalpose" / "annotations.json").read_text())["items"]
    found = {photo.name.split("/")[-1]: photo for photo in photos(collection)}
    assert len(found) == len(items) == 100
    for number in range(0, 100, 9):
        photo, item = found[str(number)], items[number]
        stem = Path(item["mask"]).stem.replace("_a", "_")
        crop = DATA / "animalpose" / item["category"] / "train" / f"{stem}_keypoints.json"
        x0, y0, side = (float(value) for value in crop.with_name(f"{stem}_box.txt").read_text().split()[1:4])
        raw = photo.source.read()
        assert abs(raw.box.width - side) <= 0.03 * side
        stored = np.array(json.loads(crop.read_text())["keypoints"])
        assert np.array_equal(stored[:, 2], raw.keypoints[:, 2])
        known = stored[:, 2] > 0
        ours = raw.keypoints[known, :2] * raw.box.width / 256 + [raw.box.x0, raw.box.y0]
        np.testing.assert_allclose(ours, stored[known, :2] * side / 256 + [x0, y0], atol=0.02)


@needs_data
def test_stanfordextra_keypoints_lie_on_the_dogs():
    collection = StanfordExtraPhotos(
        root=str(DATA / "raw" / "stanfordextra"), annotations="StanfordExtra_sample.json", train_indices=None, val_indices=None,
        test_indices=None, images="sample_imgs", crop_size=128, min_visibility=0.5,
    )  # fmt: skip
    on_the_dog = []
    for photo in photos(collection)[::3]:
        raw = photo.source.read()
        places = raw.keypoints[raw.keypoints[:, 2] > 0, :2].astype(int).clip(0, 127)
        on_the_dog.extend(raw.mask[places[:, 1], places[:, 0]])
    assert len(on_the_dog) > 100
    assert np.mean(on_the_dog) > 0.85


@needs_data
def test_crops_with_named_keypoints():
    collection = FaunaFolder(root=str(DATA / "animalpose"), photograph_pattern=r"(.+_\d+)_\d+")
    assert collection.keypoint_names == KEYPOINTS
    horses = collection.categories()["horse"].train
    assert len(horses) == 123
    on_the_horse = []
    for photo in horses[::12]:
        raw = photo.source.read()
        places = raw.keypoints[raw.keypoints[:, 2] > 0, :2].astype(int).clip(0, 255)
        on_the_horse.extend(raw.mask[places[:, 1], places[:, 0]])
    assert np.mean(on_the_horse) > 0.85
