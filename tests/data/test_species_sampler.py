"""Batches of one species: balance, repetition, back views, and random access."""

from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from fauna.data.species_sampler import SpeciesSampler, epoch_length
from fauna.errors import FaunaError
from fauna.random import derive_seed


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
    assert epoch_length(11, 3) == 11 + 8
    assert epoch_length(11, 0) == 11
    sampler = make(photos=(10,), back=[2], batch_size=6)
    counts = Counter(photo for step in range(3 * 9) for photo in sampler.batch(step).photos)
    assert set(counts) == set(range(12))
    assert all(counts[photo] == 9 for photo in range(10))
    assert counts[10] == counts[11] == 4 * 9


def slow_photos(sampler: SpeciesSampler, category: int, visit: int) -> tuple[int, ...]:
    """All entries of all epochs up to the batch, written out."""
    photos, back_views = sampler.photos[category], sampler.back_views[category]
    entries = [*range(photos), *(photos + slot % back_views for slot in range(sampler.entries[category] - photos))]
    sequence: list[int] = []
    while len(sequence) < (visit + 1) * sampler.batch_size:
        seed = derive_seed(sampler.seed, "photos", category, len(sequence) // len(entries))
        sequence += [entries[place] for place in np.random.default_rng(seed).permutation(len(entries))]
    return tuple(sequence[visit * sampler.batch_size : (visit + 1) * sampler.batch_size])


def test_batches_against_written_out_epochs():
    sampler = make(photos=(20, 7, 3), back=[0, 2, 1], batch_size=5)
    for step in [*range(60), 3, 40, 0]:
        plan = sampler.batch(step)
        assert plan.photos == slow_photos(sampler, plan.category, step // 3)


def test_ten_million_photos_cost_no_more_than_their_order():
    sampler = make(photos=(10_000_000, 3), batch_size=64)
    plans = [sampler.batch(step) for step in range(6)]
    assert all(min(plan.photos) >= 0 and max(plan.photos) < sampler.photos[plan.category] for plan in plans)
    assert sum(order.nbytes for order in sampler._orders.values()) < 41e6


def test_orders_of_past_epochs_are_let_go():
    sampler = make(batch_size=4)
    for step in range(200):
        sampler.batch(step)
    assert len(sampler._orders) <= 2 * 3


def test_threads_get_the_same_batches():
    sampler = make()
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(sampler.batch, range(300))) == [make().batch(step) for step in range(300)]


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
