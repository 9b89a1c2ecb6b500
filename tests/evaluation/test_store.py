"""Bundles of arrays survive interruptions, and are refused where they do not belong."""

import dataclasses

import numpy as np
import pytest

from fauna.data.truth import Truth3D
from fauna.errors import FaunaError
from fauna.evaluation import store as module
from fauna.evaluation.records import pack_prediction, pack_sample, unpack_prediction, unpack_sample
from fauna.evaluation.store import ArrayStore, Item
from tests.evaluation.objects import box_prediction, box_sample, jpeg

IDENTITY = {"checkpoint": "a", "size": 32}


def item(name: str) -> Item:
    return Item(name, {"x": np.arange(3) + len(name)}, {"name": name})


def names(store: ArrayStore) -> list[str]:
    return [each.name for each in store.items()]


def test_bundles_come_back_in_order(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "SHARD_SIZE", 2)
    store = ArrayStore(tmp_path, identity=IDENTITY)
    for name in ("a", "bb", "ccc"):
        store.add(item(name))
    store.flush()
    again = ArrayStore(tmp_path, identity=None)
    assert again.names == ["a", "bb", "ccc"]
    assert again.identity == IDENTITY
    for found, name in zip(again.items(), ("a", "bb", "ccc"), strict=True):
        assert found.notes == {"name": name}
        np.testing.assert_array_equal(found.arrays["x"], np.arange(3) + len(name))


def test_an_interruption_costs_at_most_the_open_shard(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "SHARD_SIZE", 2)
    store = ArrayStore(tmp_path, identity=IDENTITY)
    for name in ("a", "b", "c"):
        store.add(item(name))
    del store  # killed: c was never written
    again = ArrayStore(tmp_path, identity=IDENTITY)
    assert again.names == ["a", "b"]
    again.add(item("c"))
    again.flush()
    assert names(ArrayStore(tmp_path, identity=IDENTITY)) == ["a", "b", "c"]


def test_what_depends_on_all_photographs_is_made_anew_not_refused(tmp_path):
    first = ArrayStore(tmp_path, identity={**IDENTITY, "photos": "few"}, renewed_by=("photos",))
    first.add(item("a"))
    first.flush()
    assert ArrayStore(tmp_path, identity={**IDENTITY, "photos": "few"}, renewed_by=("photos",)).names == ["a"]
    with pytest.raises(FaunaError, match="made with checkpoint 'a' instead of 'b'"):
        ArrayStore(tmp_path, identity={**IDENTITY, "checkpoint": "b", "photos": "many"}, renewed_by=("photos",))
    again = ArrayStore(tmp_path, identity={**IDENTITY, "photos": "many"}, renewed_by=("photos",))
    assert again.names == []
    again.add(item("b"))
    again.flush()
    assert names(ArrayStore(tmp_path, identity=None)) == ["b"]


def test_a_failed_write_leaves_the_old_index(tmp_path, monkeypatch):
    store = ArrayStore(tmp_path, identity=IDENTITY)
    store.add(item("a"))
    store.flush()
    before = (tmp_path / "index.json").read_bytes()
    monkeypatch.setattr(module, "write_atomically", _fail)
    store.add(item("b"))
    with pytest.raises(OSError, match="disk full"):
        store.flush()
    assert (tmp_path / "index.json").read_bytes() == before
    assert names(ArrayStore(tmp_path, identity=IDENTITY)) == ["a"]


def _fail(*arguments):
    raise OSError("disk full")


def test_an_empty_store_is_a_store(tmp_path):
    ArrayStore(tmp_path / "empty", identity=IDENTITY).flush()
    assert names(ArrayStore(tmp_path / "empty", identity=None)) == []


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda folder: (folder / "index.json").unlink(), "without one"),
        (lambda folder: (folder / "index.json").write_text("{"), "broken one"),
        (lambda folder: (folder / "shard-00000.npz").write_bytes(b"PK" + b"x" * 30), "readable shard"),
        (lambda folder: (folder / "shard-00000.npz").unlink(), "readable shard"),
    ],
)
def test_damage_is_reported_in_one_line(tmp_path, spoil, words):
    store = ArrayStore(tmp_path, identity=IDENTITY)
    store.add(item("a"))
    store.flush()
    spoil(tmp_path)
    with pytest.raises(FaunaError, match=words) as caught:
        names(ArrayStore(tmp_path, identity=None))
    assert "\n" not in str(caught.value)


def test_another_evaluations_folder_is_refused(tmp_path):
    store = ArrayStore(tmp_path, identity=IDENTITY)
    store.add(item("a"))
    store.flush()
    with pytest.raises(FaunaError, match="made with checkpoint 'a' instead of 'b'; choose another out"):
        ArrayStore(tmp_path, identity={**IDENTITY, "checkpoint": "b"})


def test_predictions_and_samples_keep_every_bit(tmp_path):
    prediction = box_prediction("long/0", "long", (1.0, 0.5, 0.4))
    truth = Truth3D(
        camera_from_world=prediction.camera_from_world,
        clip_from_world=prediction.clip_from_world,
        azimuth_deg=30.0,
        elevation_deg=-5.0,
        verts=prediction.verts,
        faces=prediction.faces,
        legs=np.full(8, -1, np.int32),
        keypoints=np.full((4, 3), np.nan, np.float32),
    )
    sample = dataclasses.replace(box_sample(prediction), truth=truth)
    store = ArrayStore(tmp_path, identity=IDENTITY)
    store.add(pack_prediction(prediction, terms={"iou": 0.5}))
    store.add(pack_sample(sample, thumbnail=jpeg()))
    store.flush()
    first, second = ArrayStore(tmp_path, identity=None).items()
    assert first.notes["terms"] == {"iou": 0.5}
    _assert_equal(unpack_prediction(first), prediction)
    again = unpack_sample(second, sample.keypoint_names)
    _assert_equal(dataclasses.replace(again, truth=None), dataclasses.replace(sample, truth=None))
    assert again.truth is not None
    _assert_equal(again.truth, truth)


def test_a_sample_without_anything_stays_without(tmp_path):
    sample = dataclasses.replace(box_sample(box_prediction("a", "long", (1, 1, 1)), keypoints=False), mask=None)
    again = unpack_sample(pack_sample(sample, thumbnail=jpeg()), ())
    assert again == sample


def _assert_equal(first, second):
    for field in dataclasses.fields(second):
        one, other = getattr(first, field.name), getattr(second, field.name)
        if isinstance(other, np.ndarray):
            np.testing.assert_array_equal(one, other, strict=True, err_msg=field.name)
        else:
            assert one == other, field.name
