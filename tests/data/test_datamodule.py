"""Batches as a function of seed and step."""

from dataclasses import fields

import pytest
import torch

from fauna.bank.category import CategoryBank
from fauna.build import build_encoder
from fauna.configuration import validate
from fauna.data.datamodule import PhotoDataModule
from fauna.errors import FaunaError
from fauna.types import Batch
from tests.runs import assert_equal_bits, composed, tiny


class FakeTrainer:
    def __init__(self, start: int = 0, rank: int = 0, world: int = 1, steps: int = 12) -> None:
        self.global_step, self.global_rank, self.world_size, self.max_steps = start, rank, world, steps


def data(*overrides: str, seed: int = 0) -> PhotoDataModule:
    from hydra.utils import instantiate

    cfg = composed(*tiny(*overrides))
    validate(cfg)
    module = instantiate(cfg.data, _convert_="all", _partial_=True)(encoder=build_encoder(cfg))
    module.prepare(seed=seed, report=lambda line: None)
    return module


def steps(module: PhotoDataModule, **trainer: int) -> list[list[Batch]]:
    module.trainer = FakeTrainer(**trainer)
    return list(module.train_dataloader())


def content(batches: list[Batch]) -> list[tuple]:
    return [(b.names, b.category, b.images, b.masks, b.features.global_) for b in batches]


@pytest.mark.parametrize("start", [1, 5, 11])
def test_batch_of_a_step_does_not_depend_on_where_a_run_starts(start):
    full, late = steps(data()), steps(data(), start=start)
    assert len(full) == 12
    assert len(late) == 12 - start
    for one, other in zip(full[start:], late, strict=True):
        assert_equal_bits(content(one), content(other))


def test_seed_changes_photos_and_flips():
    first, again, other = (steps(data(seed=seed)) for seed in (0, 0, 1))
    names = [[batch.names for step in run for batch in step] for run in (first, again, other)]
    assert names[0] == names[1] != names[2]


def test_every_batch_is_of_one_species_and_both_are_visited():
    found = [batch for step in steps(data()) for batch in step]
    assert {batch.category for batch in found} == {0, 1}
    for batch in found:
        assert {name.split("/")[1] for name in batch.names} == {["long", "round"][batch.category]}
        assert all("/train/" in name for name in batch.names)


def test_two_processes_see_what_one_accumulates():
    one = steps(data("data.accumulate=2"), steps=6)
    ranks = [steps(data(), rank=rank, world=2, steps=6) for rank in (0, 1)]
    for step, micros in enumerate(one):
        assert_equal_bits(content(micros), content([ranks[0][step][0], ranks[1][step][0]]))


def test_training_sees_no_camera_keypoints_or_shape():
    known = {"images", "masks", "distance_inside", "distance_outside", "valid", "category", "names"}
    known |= {"features", "encoder_images", "feature_targets"}
    assert {field.name for field in fields(Batch)} == known
    batch = steps(data(), steps=1)[0][0]
    assert batch.feature_targets is None
    assert batch.encoder_images is None
    assert batch.masks.shape == batch.valid.shape == batch.distance_inside.shape == (2, 32, 32)
    assert 0 <= batch.images.min() < batch.images.max() <= 1


def test_mirrored_photos_are_mirrored_throughout():
    plain, mirrored = (steps(data(f"data.flip_probability={p}"))[3][0] for p in (0.0, 1.0))
    assert plain.names == mirrored.names
    for name in ("images", "masks", "distance_inside", "distance_outside", "valid"):
        assert torch.equal(getattr(plain, name).flip(-1), getattr(mirrored, name)), name
    assert not torch.equal(plain.features.tokens, mirrored.features.tokens)


def test_memory_budget_changes_nothing():
    assert_equal_bits(content(steps(data())[4]), content(steps(data("data.memory_megabytes=0"))[4]))


def test_validation_photos_are_those_of_the_split():
    module = data()
    names = [batch[0].names[0] for batch in module.val_dataloader()]
    assert sorted(names) == ["blobs/long/val/e", "blobs/round/val/e"]
    assert [batch.names for batch in module.preview_photos(1)] == [("blobs/long/val/e",)]


def test_held_out_species_are_never_trained_on():
    module = data("data.held_out=[round]")
    assert module.train_species == ["long"]
    assert {batch.category for step in steps(module) for batch in step} == {0}
    assert {photo.category for photo in module.photos("held_out")} == {"round"}
    assert module.single(module.photos("held_out")[0]).category is None


def test_category_indices_are_those_of_the_weights():
    module = data()
    first, second = module.train_species
    photos = {photo.category: photo for photo in module.photos("train")}
    assert (module.single(photos[first]).category, module.single(photos[second]).category) == (0, 1)
    module.number_species([second, "unicorn"])
    assert module.single(photos[second]).category == 0
    unknown = module.single(photos[first])
    assert unknown.category is None
    bank = CategoryBank(num_categories=2, value_dim=3, init=0.1)
    with pytest.raises(FaunaError, match="bank=category"):
        bank(torch.zeros(1, 4), unknown.category)


@pytest.mark.parametrize("key", ["batch_size", "accumulate", "fit_photos"])
def test_impossible_numbers_name_their_key(key):
    with pytest.raises(Exception, match=rf"data.{key}: expected a number >= 1, got 0") as caught:
        data(f"data.{key}=0")
    assert isinstance(caught.value, FaunaError) or isinstance(caught.value.__cause__, FaunaError)


def test_fitting_photos_are_seeded_and_bounded():
    module = data("data.fit_photos=3")
    assert len(list(module.feature_samples())) == 3
