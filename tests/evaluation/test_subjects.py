"""Which photographs are looked at: nothing of the training in a test, held-out species are those the weights never saw."""

import json
import shutil

import pytest
from hydra.utils import instantiate

from fauna.build import build_encoder
from fauna.errors import FaunaError
from fauna.evaluation.protocol import photo_keys, photos_digest, training_warning
from fauna.evaluation.subjects import Subjects, choose, dataset_facts
from fauna.evaluation.trained_on import TrainingPhotos, training_photos
from tests.runs import composed, dataset, draw_dataset, tiny

ZOO = ("+experiment=tiny", "data=zoo", "data.source.species=[horse,cow,camel]", "data.held_out=[camel]")
TWENTY, HUNDRED = "data.source.photos_per_species=20", "data.source.photos_per_species=100"


def trained(*overrides: str, species: tuple[str, ...]) -> TrainingPhotos:
    cfg = composed(*overrides)
    return training_photos(cfg, species, build_encoder(cfg))


def chosen(
    training: TrainingPhotos,
    *overrides: str,
    split: str | None = None,
    given: bool = True,
    max_photos: int | None = None,
) -> Subjects:
    cfg = composed(*overrides)
    data = instantiate(cfg.data, _convert_="all", _partial_=True)(encoder=build_encoder(cfg))
    return choose(data, training, split=split, given=given, seed=0, max_photos=max_photos)


def individuals(subjects: Subjects) -> set[str]:
    return {photo.photograph for photo in subjects.photos}


# --- photographs of the training -------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(), ("data.source.image_size=128",)])
def test_individuals_of_a_smaller_zoo_are_left_out_of_the_test_of_a_larger_one(size):
    training = trained(*ZOO, TWENTY, species=("cow", "horse"))
    assert training.problem is None
    known = {photo.photograph for photo in training.photos}
    subjects = chosen(training, *ZOO, HUNDRED, *size)
    assert subjects.split == "test"
    assert subjects.left_out
    assert not individuals(subjects) & known
    assert subjects.trained_on == ()
    limited = chosen(training, *ZOO, HUNDRED, *size, max_photos=4)
    assert [len(photos) for photos in limited.groups.values()] == [4, 4]
    other_seed = chosen(training, *ZOO, HUNDRED, *size, "data.source.seed=1")
    assert other_seed.left_out == ()


def test_on_request_they_are_looked_at_and_counted():
    training = trained(*ZOO, TWENTY, species=("cow", "horse"))
    for split in ("all", "train"):
        subjects = chosen(training, *ZOO, HUNDRED, split=split)
        known = {photo.photograph for photo in training.photos}
        expected = {photo.name for photo in subjects.photos if photo.photograph in known}
        assert set(subjects.trained_on) == expected
        assert len(expected) > 10
        assert subjects.left_out == ()


def test_the_dataset_of_the_training_keeps_its_own_test():
    training = trained(*ZOO, HUNDRED, species=("cow", "horse"))
    subjects = chosen(training, *ZOO, HUNDRED, given=False)
    assert (subjects.left_out, subjects.trained_on) == ((), ())
    assert len(subjects.groups["metrics"]) == 24


def test_a_copied_folder_is_known_by_its_pictures_and_a_linked_one_by_its_place(tmp_path, monkeypatch):
    training = trained(*tiny(), species=("long", "round"))
    copied, linked = tmp_path / "copy", tmp_path / "link"
    shutil.copytree(dataset(), copied)
    linked.symlink_to(dataset())
    monkeypatch.chdir(dataset().parent)
    for root in (copied, linked, dataset().name):
        subjects = chosen(training, *tiny(f"data.root='{root}'"))
        assert subjects.split == "all"
        assert len(subjects.photos) == 10
        assert len(subjects.trained_on) == 8
        assert {name.split("/")[2] for name in subjects.trained_on} == {"train"}
    shutil.rmtree(copied / "round")
    for part in ("rgb", "mask"):
        shutil.copy(copied / "long" / "train" / f"a_{part}.png", copied / "long" / "val" / f"e_{part}.png")
    with pytest.raises(FaunaError, match="not trained on, got 1 of its training photos only; use data.split=all"):
        chosen(training, *tiny(f"data.root='{copied}'"), split="val")


def test_all_crops_of_a_photograph_count_as_trained_on(tmp_path):
    """Two crops named as of one photograph; only one of them was in the training folder."""
    first, second = tmp_path / "first", tmp_path / "second"
    (first / "long" / "train").mkdir(parents=True)
    for part in ("rgb", "mask"):
        shutil.copy(dataset() / "long" / "train" / f"a_{part}.png", first / "long" / "train" / f"2007_001_1_{part}.png")
        shutil.copy(dataset() / "long" / "train" / f"b_{part}.png", first / "long" / "train" / f"x_{part}.png")
    shutil.copytree(first, second)
    for part in ("rgb", "mask"):
        shutil.copy(dataset() / "long" / "val" / f"e_{part}.png", second / "long" / "train" / f"2007_001_2_{part}.png")
    training = trained(*tiny(f"data.root='{first}'", "data.val_max=0"), species=("long",))
    subjects = chosen(training, *tiny(f"data.root='{second}'"))
    assert len(subjects.trained_on) == 3


def test_a_training_folder_that_is_gone_is_said(tmp_path):
    root = draw_dataset(tmp_path / "gone")
    cfg = composed(*tiny(f"data.root='{root}'"))
    shutil.rmtree(root)
    training = training_photos(cfg, ("long", "round"), build_encoder(cfg))
    assert training.identity is None
    assert training.problem is not None
    subjects = chosen(training, *tiny())
    facts = dataset_facts("x", {}, {}, subjects, training)
    assert "is not known: data=fauna expects a folder of crops" in str(training_warning(facts))


# --- species ---------------------------------------------------------------------------------------------------------


def test_held_out_are_the_species_the_weights_never_saw():
    """Whatever ``data.held_out`` says: the command line knows nothing of the training."""
    for held_out in ("[]", "[long]", "[round]"):
        training = trained(*tiny(), species=("long",))
        subjects = chosen(training, *tiny(f"data.held_out={held_out}"))
        assert {photo.category for photo in subjects.groups["metrics"]} == {"long"}
        assert {photo.category for photo in subjects.groups["held_out"]} == {"round"}
    only = chosen(trained(*tiny(), species=("long",)), *tiny(), split="held_out")
    assert set(only.groups) == {"held_out"}
    neither = chosen(trained(*tiny(), species=("else",)), *tiny(), given=False)
    assert (neither.split, set(neither.groups)) == ("held_out", {"held_out"})


# --- the digest of a dataset -----------------------------------------------------------------------------------------


def test_digest_covers_masks_and_keypoints_and_survives_missing_files(tmp_path):
    root = draw_dataset(tmp_path / "data", train=2, val=0)
    training = TrainingPhotos(("long", "round"), None, (), "unknown")

    def digest() -> tuple[str, set[str]]:
        photos = chosen(training, *tiny(f"data.root='{root}'")).photos
        return photos_digest(photo_keys(photos)), {photo.source.content_key() for photo in photos}

    digests, pictures = zip(digest(), strict=True)
    folder = root / "long" / "train"
    for change in (
        lambda: shutil.copy(folder / "b_mask.png", folder / "a_mask.png"),
        lambda: (folder / "a_keypoints.json").write_text(json.dumps({"keypoints": [[1, 2, 1]]})),
        lambda: (folder / "a_mask.png").unlink(),
    ):
        change()
        found, keys = digest()
        digests, pictures = (*digests, found), (*pictures, keys)
    assert len(set(digests)) == 4
    assert all(keys == pictures[0] for keys in pictures)  # cached features stay what they are
    (folder / "a_rgb.png").write_bytes((folder / "b_rgb.png").read_bytes())
    assert digest()[0] not in digests
