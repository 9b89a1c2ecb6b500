"""Animal3D, A-CSM's PASCAL files and StanfordExtra, from fixtures in their formats."""

import json
from typing import Any

import numpy as np
import pytest

from fauna.data.readers.animal3d import Animal3DPhotos
from fauna.data.readers.keypoints import KEYPOINT_SETS
from fauna.data.readers.pascal import PascalPhotos
from fauna.data.readers.stanfordextra import StanfordExtraPhotos
from fauna.errors import FaunaError
from tests.data.readers.fixtures import (
    ANIMALS,
    animal3d_folder,
    ellipse,
    keypoints_of,
    pascal_folder,
    stanfordextra_folder,
)


def in_photograph(raw) -> np.ndarray:
    """Keypoints of a crop, back in the photograph, x and y of the annotated ones."""
    points = raw.keypoints[raw.keypoints[:, 2] > 0, :2]
    return points * raw.box.width / raw.image.shape[0] + [raw.box.x0, raw.box.y0]


def expected_points(number: int) -> np.ndarray:
    return np.array(keypoints_of(ANIMALS[number]))[:2, :2] + 0.5


def check_photo(photo, number: int, *, repeats: int = 1) -> None:
    raw = photo.source.read()
    assert raw.mask_source == "annotation"
    np.testing.assert_allclose(in_photograph(raw), np.tile(expected_points(number), (repeats, 1)))
    area = raw.mask.mean() * raw.box.width**2
    assert area == pytest.approx(ellipse(ANIMALS[number]).sum(), rel=0.03)


# --- Animal3D --------------------------------------------------------------------------------------------------------


def animal3d(folder, **changes) -> Animal3DPhotos:
    given: dict[str, Any] = {
        "root": str(folder), "annotations": "train.json", "test_annotations": "test.json", "images": ".", "crop_size": 64,
        "species": None, "species_pattern": r".*_([A-Za-z-]+)\.[A-Za-z]+", "keypoint_names": None, "min_visibility": 0.5,
    }  # fmt: skip
    return Animal3DPhotos(**{**given, **changes})


def test_animal3d(tmp_path):
    collection = animal3d(animal3d_folder(tmp_path / "a3d"))
    zebra = collection.categories()["zebra"]
    assert [len(part) for part in (zebra.train, zebra.val, zebra.test)] == [2, 0, 1]
    for number, photo in enumerate(zebra.train):
        check_photo(photo, number)
    assert zebra.train[1].photograph == "a3d/images/train/n0/n0_1_zebra.png"
    assert collection.keypoint_names == ("keypoint_00", "keypoint_01", "keypoint_02")
    assert animal3d(tmp_path / "a3d", keypoint_names=["L_Eye", "R_Eye", "Chin"]).keypoint_names[0] == "left_eye"
    assert collection.left_out == ()


def test_animal3d_leaves_out_with_a_reason_and_names_what_is_wrong(tmp_path):
    folder = animal3d_folder(tmp_path)
    (folder / "masks/train/n0/n0_1_zebra.png").unlink()
    collection = animal3d(folder)
    assert len(collection.categories()["zebra"].train) == 1
    assert [reason for _, reason in collection.left_out] == ["mask masks/train/n0/n0_1_zebra.png is missing"]
    collection = animal3d(folder, species_pattern=r".*test.*_([a-z]+)\.png")
    assert len(collection.categories()["zebra"].test) == 1
    assert "names no species; see data.source.species_pattern" in collection.left_out[0][1]
    with pytest.raises(FaunaError, match="expects 2 keypoints, one per name, got 3"):
        animal3d(folder, keypoint_names=["a", "b"]).categories()
    content = json.loads((folder / "train.json").read_text())
    del content["data"][1]["mask_path"]
    (folder / "train.json").write_text(json.dumps(content))
    with pytest.raises(
        FaunaError, match=r"entry 1 expects the keys img_path, mask_path, keypoint_2d, got no mask_path"
    ):
        animal3d(folder).categories()


# --- PASCAL ----------------------------------------------------------------------------------------------------------


def pascal(folder, **changes) -> PascalPhotos:
    given: dict[str, Any] = {
        "root": str(folder), "annotations": "data", "images": "JPEGImages", "species": ["horse", "cow"], "crop_size": 64,
        "min_visibility": 0.5,
    }  # fmt: skip
    return PascalPhotos(**{**given, **changes})


def test_pascal(tmp_path):
    collection = pascal(pascal_folder(tmp_path / "voc"))
    found = collection.categories()
    assert list(found) == ["cow", "horse"]
    horse = found["horse"]
    assert [len(part) for part in (horse.train, horse.val, horse.test)] == [0, 2, 0]
    assert [photo.name for photo in horse.val] == ["voc/horse/2008_000001_1", "voc/horse/2008_000001_2"]
    assert {photo.photograph for photo in horse.val + found["cow"].val} == {"voc/2008_000001"}
    for number, photo in enumerate(horse.val):
        check_photo(photo, number)
        assert photo.source.box == ANIMALS[number]
    assert collection.keypoint_names == ("left_eye", "right_eye", "tailbase")


def test_pascal_names_what_is_wrong(tmp_path):
    folder = pascal_folder(tmp_path / "a")
    with pytest.raises(FaunaError, match=r"expects dog_train.mat or dog_val.mat, got neither; check data.root"):
        pascal(folder, species=["dog"]).categories()
    with pytest.raises(
        FaunaError, match=r"kp_perm_inds to swap left and right of kp_names, got others for \['L_Eye', 'R_Eye'\]"
    ):
        pascal(pascal_folder(tmp_path / "b", mirror=(1, 2, 3))).categories()
    (folder / "data" / "horse_val.mat").write_bytes(b"no matrix")
    with pytest.raises(
        FaunaError, match=r"horse_val.mat expects a .mat file up to version 7, got .*; download it again"
    ):
        pascal(folder).categories()
    (folder / "data" / "horse_kps.mat").unlink()
    with pytest.raises(FaunaError, match=r"horse_kps.mat expects a .mat file, got nothing there"):
        _ = pascal(folder).keypoint_names
    with pytest.raises(FaunaError, match=r"data.source.species: expected species that name .mat files, got none"):
        pascal(folder, species=[])


# --- StanfordExtra ---------------------------------------------------------------------------------------------------


def stanfordextra(folder, **changes) -> StanfordExtraPhotos:
    given: dict[str, Any] = {
        "root": str(folder), "annotations": "StanfordExtra_v12.json", "train_indices": None, "val_indices": None,
        "test_indices": None, "images": "Images", "crop_size": 64, "min_visibility": 0.5,
    }  # fmt: skip
    return StanfordExtraPhotos(**{**given, **changes})


def test_stanfordextra(tmp_path):
    folder = stanfordextra_folder(tmp_path)
    collection = stanfordextra(folder)
    assert collection.keypoint_names == KEYPOINT_SETS["stanfordextra"].canonical
    dog = collection.categories()["dog"]
    assert len(dog.train) == 4
    for number, photo in enumerate(dog.train):
        check_photo(photo, number % 2, repeats=8)
    parted = stanfordextra(folder, test_indices="test.npy").categories()["dog"]
    assert parted.test == dog.train[2:3]
    assert parted.train == dog.train[:2] + dog.train[3:]


def test_stanfordextra_names_what_is_wrong(tmp_path):
    folder = stanfordextra_folder(tmp_path)
    np.save(folder / "far.npy", np.array([4]))
    with pytest.raises(FaunaError, match=r"far.npy expects indices below 4, got 4; use files of one version"):
        stanfordextra(folder, val_indices="far.npy").categories()
    with pytest.raises(FaunaError, match=r"gone.npy expects a .npy file of indices, got .*; check data.source"):
        stanfordextra(folder, val_indices="gone.npy").categories()
    (folder / "Images" / "n0-breed" / "n0_1.png").unlink()
    collection = stanfordextra(folder)
    assert len(collection.categories()["dog"].train) == 3
    assert [reason for _, reason in collection.left_out] == ["photograph n0-breed/n0_1.png is missing"]
    (folder / "StanfordExtra_v12.json").write_text('[{"img_path": "a"}]')
    with pytest.raises(FaunaError, match="entry 0 expects the keys .* got no img_width"):
        stanfordextra(folder).categories()
