"""Data sources list photos; what the zoo knows beyond its pictures is for evaluation."""

import numpy as np
import pytest

from fauna.data.fauna_folder import CategoryPhotos
from fauna.data.feature_cache import default_cache_root
from fauna.data.sources import FaunaFolder, ZooPhotos
from fauna.data.truth import LEGS
from fauna.errors import FaunaError
from tests.runs import blob, dataset

PATTERN = r"(.+_\d+)_\d+"


def zoo(**changes) -> ZooPhotos:
    return ZooPhotos(**{"seed": 0, "photos_per_species": 2, "image_size": 32, "species": ["dog", "horse"], **changes})


def test_folder_lists_the_drawn_dataset():
    found = FaunaFolder(root=str(dataset()), photograph_pattern=PATTERN).categories()
    assert {name: (len(p.train), len(p.val)) for name, p in found.items()} == {"long": (4, 1), "round": (4, 1)}
    raw = found["long"].train[1].source.read()
    image, mask = blob("long", 1)
    assert np.array_equal(raw.image, image)
    assert np.array_equal(raw.mask, mask > 0)


def test_folder_needs_a_root():
    with pytest.raises(FaunaError, match=r"data.root: expected a dataset folder .* got none; give data.root=FOLDER"):
        FaunaFolder(root=None, photograph_pattern=PATTERN)


def test_identity_tells_folders_apart(tmp_path):
    names = {FaunaFolder(root=str(tmp_path / parent / "set"), photograph_pattern=PATTERN).identity for parent in "ab"}
    assert len(names) == 2
    assert all(name.startswith("set-") for name in names)


def test_zoo_photos_and_their_keypoints_survive_the_cache():
    collection = zoo()
    found = collection.categories()
    assert list(found) == ["dog", "horse"]
    assert all(isinstance(photos, CategoryPhotos) for photos in found.values())
    source = found["dog"].train[0].source
    drawn, cached = source.read(), source.read()
    for raw in (drawn, cached):
        assert raw.keypoints.shape == (len(collection.keypoint_names), 3)
        assert set(raw.keypoints[:, 2]) <= {0.0, 1.0}
        assert raw.image.shape == (32, 32, 3)
        assert raw.mask.any()
    assert np.array_equal(drawn.image, cached.image)
    assert np.array_equal(drawn.mask, cached.mask)
    assert np.array_equal(drawn.keypoints, cached.keypoints)
    assert drawn.box == cached.box


def test_truth_of_the_zoo_fits_its_photo():
    collection = zoo(image_size=64)
    source = collection.categories()["horse"].train[1].source
    raw, truth = source.read(), source.truth()
    clip = np.column_stack([truth.keypoints, np.ones(len(truth.keypoints))]) @ truth.clip_from_world.T
    pixels = (clip[:, :2] / clip[:, 3:] + 1) * 32
    np.testing.assert_allclose(pixels, raw.keypoints[:, :2], atol=1e-9)
    shown = raw.keypoints[raw.keypoints[:, 2] > 0].astype(int)
    near = [raw.mask[max(y - 3, 0) : y + 4, max(x - 3, 0) : x + 4].any() for x, y, _ in shown]
    assert all(near)
    assert len(near) >= 5
    side = {name: truth.verts[truth.legs == leg].mean(axis=0) for leg, name in enumerate(LEGS)}
    for name, middle in side.items():
        paw = truth.keypoints[collection.keypoint_names.index(f"{name}_paw")]
        others = [np.linalg.norm(other - paw) for key, other in side.items() if key != name]
        assert np.linalg.norm(middle - paw) < min(others)


def test_damaged_zoo_picture_is_drawn_again():
    source = zoo().categories()["horse"].train[1].source
    drawn = source.read()
    (path,) = default_cache_root().glob(f"zoo/*/{source.content_key()}.png")
    path.write_bytes(path.read_bytes()[:50])
    assert np.array_equal(source.read().image, drawn.image)


def test_zoo_keys_depend_on_everything_that_changes_a_picture():
    keys = {
        collection.categories()["dog"].train[index].source.content_key()
        for collection in (zoo(), zoo(seed=1), zoo(image_size=64))
        for index in (0, 1)
    }
    assert len(keys) == 6


def test_unknown_species_are_named():
    with pytest.raises(FaunaError, match=r"data.source.species: expected names among .*dog.* got \['unicorn'\]"):
        zoo(species=["dog", "unicorn"])
