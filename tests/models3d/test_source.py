"""``data=models3d`` as a collection: species, individuals, families, licences, caching; and collections of collections."""

import numpy as np
import pytest

from fauna.data.collections import PhotoCollections
from fauna.data.feature_cache import default_cache_root
from fauna.data.sources import ZooPhotos
from fauna.data.splits import SplitSize, complete_splits
from fauna.errors import FaunaError
from fauna.models3d.catalogue import CATALOGUE, CC_BY
from fauna.models3d.source import Models3D
from fauna.zoo.body import KEYPOINTS
from tests.models3d.glb_writer import write_quadruped


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models")
    pony = write_quadruped(folder / "Pony.glb").read_bytes()
    for known in ("Horse_Farm_A", "Cow_Farm_A", "Zebra_Farm_A"):
        (folder / "farm").mkdir(exist_ok=True)
        (folder / "farm" / f"{known}.glb").write_bytes(pony)
    for known in ("fox-cat", "fox-fox", "fox-animations"):  # never opened here: their names say enough
        (folder / f"{known}.glb").write_bytes(b"")
    return folder


def collection(root, **changes) -> Models3D:
    settings = {"seed": 0, "photos_per_model": 6, "image_size": 32, "views": "photographer", "models": None,
                "test_families": [], "include_cc_by": False}  # fmt: skip
    return Models3D(root=str(root), **{**settings, **changes})


def test_species_individuals_and_unknown_files(root):
    found = collection(root).categories()
    assert {name: len(photos.train) for name, photos in found.items()} == {
        "cow": 6,
        "fox": 6,
        "horse": 6,
        "pony": 6,
        "zebra": 6,
    }
    photos = found["pony"].train
    assert [photo.photograph.rpartition("-")[2] for photo in photos] == ["0"] * 4 + ["1"] * 2
    assert len({photo.name for each in found.values() for photo in each.train}) == 30
    assert collection(root).keypoint_names == KEYPOINTS


def test_licences_and_twins(root):
    assert [entry.licence for entry in CATALOGUE.values()].count(CC_BY) == 1
    assert CATALOGUE["fox-cat"].licence == CC_BY
    assert "fox-cat" not in collection(root).entries
    assert "fox-cat" in collection(root, include_cc_by=True).entries
    assert "fox-fox" not in collection(root).entries  # the mesh of fox-animations
    assert list(collection(root, models=["fox-fox"]).entries) == ["fox-fox"]


def test_families_can_be_set_aside(root):
    found = collection(root, test_families=["farm horse"]).categories()
    for species in ("horse", "zebra"):  # one mesh
        assert not found[species].train
        assert len(found[species].test) == 6
    assert found["cow"].train
    assert not found["cow"].test


def test_splits_are_by_individual(root):
    listed = collection(root, photos_per_model=24, models=["Pony"]).categories()
    size = SplitSize(0.2, 6)
    split = complete_splits(listed, path=None, seed=0, val=size, test=size, held_out=[])["pony"]
    individuals = [{photo.photograph for photo in each} for each in (split.train, split.val, split.test)]
    assert all(individuals)
    assert sum(map(len, individuals)) == len(set.union(*individuals)) == 6


def test_pictures_survive_the_cache_and_truth_needs_none(root):
    source = collection(root).categories()["pony"].train[1].source
    drawn = source.read()
    path = next(default_cache_root().rglob(f"{source.content_key()}.png"))
    cached = source.read()
    np.testing.assert_array_equal(drawn.image, cached.image)
    np.testing.assert_array_equal(drawn.mask, cached.mask)
    assert drawn.box == cached.box
    path.write_bytes(path.read_bytes()[:60])
    np.testing.assert_array_equal(source.read().image, drawn.image)
    truth = source.truth()
    assert truth is not None
    assert truth.keypoints.shape == (20, 3)
    assert hash(source) == hash(collection(root).categories()["pony"].train[1].source)


def test_keys_depend_on_everything_that_changes_a_picture(root, tmp_path):
    changes = ({}, {"seed": 1}, {"image_size": 64}, {"views": "uniform"})
    keys = {
        collection(root, **each).categories()["pony"].train[i].source.content_key() for each in changes for i in (0, 1)
    }
    assert len(keys) == 8
    write_quadruped(tmp_path / "Pony.glb", squeeze=0.9)
    other = collection(tmp_path).categories()["pony"].train[0].source.content_key()
    assert other not in keys
    identities = {
        collection(root, **each).identity for each in (*changes[:3], {"models": ["Pony"]}, {"photos_per_model": 8})
    }
    assert len(identities) == 5


def test_collections_merge_species_of_one_name(root):
    zoo = ZooPhotos(seed=0, photos_per_species=5, image_size=32, species=["horse", "dog"])
    both = PhotoCollections(members={"zoo": zoo, "models3d": collection(root)})
    found = both.categories()
    assert list(found) == ["cow", "dog", "fox", "horse", "pony", "zebra"]
    assert len(found["horse"].train) == 5 + 6
    assert len({photo.name for photo in found["horse"].train}) == 11
    assert both.identity == f"{zoo.identity}+{collection(root).identity}"
    alone = PhotoCollections(members={"a": collection(root)})
    assert alone.keypoint_names == KEYPOINTS
    with pytest.raises(
        FaunaError, match="expected photos with names of their own, got models3d/Cow_Farm_A/00000 twice"
    ):
        PhotoCollections(members={"a": collection(root), "b": collection(root)}).categories()
    with pytest.raises(FaunaError, match="expected at least one collection, got none"):
        PhotoCollections(members={})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"root": None}, "data.root: expected a folder of rigged .glb models, got none"),
        ({"models": ["Cat"]}, r"data.source.models: expected names among .*Pony.* got \['Cat'\]"),
        ({"test_families": ["cats"]}, r"data.source.test_families: expected names among .* got \['cats'\]"),
    ],
)
def test_messages(root, changes, message):
    settings = {"root": str(root), "seed": 0, "photos_per_model": 1, "image_size": 32, "views": "uniform", "models": None,
                "test_families": [], "include_cc_by": False}  # fmt: skip
    with pytest.raises(FaunaError, match=message):
        Models3D(**{**settings, **changes})


def test_a_model_without_a_known_rig_is_named(tmp_path):
    data = write_quadruped(tmp_path / "Pony.glb").read_bytes().replace(b'"FrontUpLeg.L"', b'"FrontXxLeg.L"')
    (tmp_path / "Pony.glb").write_bytes(data)
    with pytest.raises(FaunaError, match=r"Pony.glb expects the joints of one of 6 known rigs.*lacks FrontUpLeg.L"):
        collection(tmp_path)
