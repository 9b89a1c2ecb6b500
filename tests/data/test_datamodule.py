"""Batches as a function of seed and step."""

import threading
from dataclasses import fields, replace

import pytest
import torch

from fauna.bank.category import CategoryBank
from fauna.build import build_encoder
from fauna.configuration import validate
from fauna.data.datamodule import PhotoDataModule
from fauna.data.species_sampler import BatchPlan, SpeciesSampler
from fauna.errors import FaunaError
from fauna.types import Batch
from tests.runs import assert_equal_bits, composed, draw_dataset, tiny


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


@pytest.mark.parametrize(("ahead", "workers"), [(1, 1), (3, 1), (3, 4), (50, 2)])
def test_preparing_ahead_changes_nothing(ahead, workers):
    here = steps(data("data.prefetch_steps=0", "data.accumulate=2"), start=3)
    module = data(f"data.prefetch_steps={ahead}", f"data.prefetch_workers={workers}", "data.accumulate=2")
    assert module.ahead > 0
    for one, other in zip(here, steps(module, start=3), strict=True):
        assert_equal_bits(content(one), content(other))


def test_prepared_steps_count_towards_the_memory_budget():
    limits = (0, 1, 50)
    modules = [data(f"data.memory_megabytes={limit}", "data.prefetch_steps=1000") for limit in limits]
    for module, limit in zip(modules, limits, strict=True):
        size = sum(tensor.nbytes for tensor in tensors(steps(module, steps=1)[0][0]))
        assert size == module.batch_size * module.loader.bytes_per_photo()
        if module.ahead:
            assert (module.ahead + 1) * size <= 5e5 * limit < (module.ahead + 2) * size
            assert (
                sum(each.size() for each in module.loader._pixels.values()) <= 1e6 * limit - (module.ahead + 1) * size
            )
    assert [module.ahead > 0 for module in modules] == [False, True, True]


def tensors(batch: Batch) -> list[torch.Tensor]:
    maps = [batch.images, batch.masks, batch.distance_inside, batch.distance_outside, batch.valid]
    return [*maps, batch.features.global_, batch.features.tokens]


def test_a_broken_photo_stops_training_with_its_own_message(tmp_path):
    root = draw_dataset(tmp_path / "blobs", train=2)
    module = data(f"data.root={root}", "data.prefetch_steps=3", "data.memory_megabytes=50")
    module.trainer = FakeTrainer()
    batches = iter(module.train_dataloader())
    next(batches)
    module.loader._pixels.clear()
    for path in root.rglob("*_mask.png"):
        path.write_bytes(b"")
    with pytest.raises(FaunaError, match="_mask.png expects a readable image") as caught:
        list(batches)
    assert "\n" not in str(caught.value)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("fauna")]


def test_back_views_follow_the_ordinary_photos(monkeypatch):
    module = data("data.prefetch_steps=0")
    pools = module.by_category
    for name, pool in pools.items():
        pools[name] = replace(pool, train=pool.train[:3], back_views=pool.train[3:])
    sampler = SpeciesSampler(
        photos_per_category=[3, 3],
        back_views_per_category=[1, 1],
        batch_size=3,
        micro_batches=1,
        flip_probability=0.5,
        seed=0,
    )
    monkeypatch.setattr(
        sampler, "batch", lambda step, index: BatchPlan(1, photos=(0, 3, 2), flips=(False, True, False))
    )
    batch = module.step_batches(0, sampler, 0)[0]
    expected = [pools["round"].train[0], pools["round"].back_views[0], pools["round"].train[2]]
    assert batch.names == tuple(photo.name for photo in expected)


def test_batches_for_a_gpu_are_page_locked_throughout(monkeypatch):
    locked = []
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.Tensor, "pin_memory", lambda tensor: locked.append(tensor) or tensor.clone())
    module = data("data.prefetch_steps=0")
    batch = steps(module, steps=1)[0][0]
    assert len(locked) == len(tensors(batch))
    assert batch.features.keys is batch.features.tokens
    monkeypatch.undo()
    assert_equal_bits(content([batch]), content(steps(module, steps=1)[0]))


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
