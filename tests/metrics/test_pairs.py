import tracemalloc

import numpy as np
import pytest

from fauna.metrics.pairs import mirror_map, ordered_pairs

NAMES = [f"photo {i}" for i in (3, 1, 4, 0, 2, 5)]


def named(names, pairs):
    return [(names[a], names[b]) for a, b in pairs]


def test_all_pairs_when_there_are_few():
    pairs = ordered_pairs(NAMES, count=30, seed=0)
    assert len({tuple(p) for p in pairs.tolist()}) == 30
    assert (pairs[:, 0] != pairs[:, 1]).all()


@pytest.mark.parametrize("count", [1, 7, 29])
def test_drawn_pairs_are_distinct_and_a_function_of_seed_and_names(count):
    first = named(NAMES, ordered_pairs(NAMES, count=count, seed=3))
    other = sorted(NAMES)
    assert first == named(other, ordered_pairs(other, count=count, seed=3))
    assert len(set(first)) == count
    assert all(a != b for a, b in first)
    seeds = {tuple(named(NAMES, ordered_pairs(NAMES, count=7, seed=s))) for s in range(6)}
    assert len(seeds) > 1


def test_every_pair_is_drawn_equally_often():
    counts = np.zeros((4, 4))
    for seed in range(600):
        for a, b in ordered_pairs(list("abcd"), count=3, seed=seed):
            counts[a, b] += 1
    off = counts[~np.eye(4, dtype=bool)]
    assert abs(off - 150).max() < 50


@pytest.mark.parametrize("count", [50, 20_000])
def test_a_few_of_very_many_pairs_take_little_memory(count):
    names = [f"{number:05d}" for number in range(20_000)]
    tracemalloc.start()
    pairs = ordered_pairs(names, count=count, seed=1)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len({tuple(pair) for pair in pairs.tolist()}) == count
    assert (pairs[:, 0] != pairs[:, 1]).all()
    assert peak < 50e6  # all of them would be 3.2 GB


@pytest.mark.parametrize("names", [[], ["one"]])
def test_no_pairs_of_one(names):
    assert ordered_pairs(names, count=5, seed=0).shape == (0, 2)


def test_mirror_maps_are_their_own_inverse():
    for names in (
        ("left_eye", "nose", "right_eye"),
        ("L_B_Elbow", "R_B_Elbow", "L_F_Paw", "R_F_Paw", "Nose"),
        ("Eye_Left", "Eye_Right", "Tail_Mid_Top"),
        ("left front paw", "right front paw", "withers"),
    ):
        mirror = mirror_map(names)
        assert (mirror[mirror] == np.arange(len(names))).all()
        sided = [any(word in name for word in ("eft", "ight", "L_", "R_")) for name in names]
        assert [i != m for i, m in enumerate(mirror)] == sided
