"""Batches of one species: balance, repetition, back views, and random access."""

from collections import Counter

import pytest

from fauna.data.species_sampler import SpeciesSampler, epoch_entries
from fauna.errors import FaunaError


def make(photos=(20, 7, 3), back=None, **changes) -> SpeciesSampler:
    settings = {"batch_size": 4, "micro_batches": 1, "flip_probability": 0.5, "seed": 0, **changes}
    return SpeciesSampler(photos_per_category=photos, back_views_per_category=back or [0] * len(photos), **settings)


def test_any_batch_without_the_ones_before():
    forward = [make().batch(step) for step in range(50)]
    fresh = [make().batch(step) for step in reversed(range(50))][::-1]
    assert forward == fresh
    assert len(set(forward)) > 40


def test_every_cycle_visits_each_species_once():
    sampler = make()
    orders = set()
    for cycle in range(30):
        order = tuple(sampler.batch(cycle * 3 + place).category for place in range(3))
        assert sorted(order) == [0, 1, 2]
        orders.add(order)
    assert len(orders) > 3


@pytest.mark.parametrize("category", [0, 1, 2])
def test_photos_come_without_replacement_epoch_by_epoch(category):
    sampler, size = make(), (20, 7, 3)[category]
    plans = [plan for plan in map(sampler.batch, range(300)) if plan.category == category]
    drawn = [photo for plan in plans for photo in plan.photos]
    epochs = [drawn[start : start + size] for start in range(0, len(drawn) - size + 1, size)]
    assert len(epochs) > 15
    assert all(sorted(epoch) == list(range(size)) for epoch in epochs)
    assert len({tuple(epoch) for epoch in epochs}) > 3
    assert all(len(plan.photos) == 4 for plan in plans)


def test_back_views_are_repeated_to_four_fifths():
    assert epoch_entries(11, 3) == (*range(11), *(11 + slot % 3 for slot in range(8)))
    assert epoch_entries(11, 0) == tuple(range(11))
    sampler = make(photos=(10,), back=[2], batch_size=6)
    counts = Counter(photo for step in range(3 * 9) for photo in sampler.batch(step).photos)
    assert set(counts) == set(range(12))
    assert all(counts[photo] == 9 for photo in range(10))
    assert counts[10] == counts[11] == 4 * 9


def test_micro_batches_of_a_step_continue_the_sequence():
    single, double = make(), make(micro_batches=2)
    for step in range(10):
        assert double.batch(step, 0) == single.batch(2 * step)
        assert double.batch(step, 1) == single.batch(2 * step + 1)


def test_flips_follow_their_probability():
    share = {
        p: sum(sum(make(flip_probability=p).batch(step).flips) for step in range(400)) / 1600 for p in (0.0, 0.5, 1.0)
    }
    assert share[0.0] == 0
    assert share[1.0] == 1
    assert 0.45 < share[0.5] < 0.55


def test_seed_matters():
    assert [make(seed=0).batch(step) for step in range(5)] != [make(seed=1).batch(step) for step in range(5)]


def test_errors():
    with pytest.raises(FaunaError, match="at least one photo for each species"):
        make(photos=(3, 0))
    with pytest.raises(FaunaError, match="at least one photo for each species"):
        make(photos=())
    with pytest.raises(FaunaError, match=r"index in \[0, 1\)"):
        make().batch(0, 1)
    with pytest.raises(FaunaError, match="positive sizes"):
        make(batch_size=0)
