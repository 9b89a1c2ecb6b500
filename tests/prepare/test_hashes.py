"""Near hashes are found without comparing all with all, and none is missed."""

import itertools

import numpy as np
import pytest

from fauna.prepare.hashes import _bands, distances, near_pairs


def planted(count: int, seed: int) -> np.ndarray:
    """Random hashes, and copies of some with up to eight bits turned."""
    rng = np.random.default_rng(seed)
    hashes = rng.integers(0, 2**64, count, dtype=np.uint64)
    near = hashes[: count // 2].copy()
    for index in range(len(near)):
        for bit in rng.choice(64, rng.integers(1, 9), replace=False):
            near[index] ^= np.uint64(1) << np.uint64(bit)
    return np.unique(np.concatenate([hashes, near]))


@pytest.mark.parametrize("bits", [0, 1, 2, 4, 6])
def test_pairs_are_those_of_comparing_all_with_all(bits):
    hashes = planted(120, seed=bits)
    slow = [
        (i, j)
        for i, j in itertools.combinations(range(len(hashes)), 2)
        if bin(int(hashes[i]) ^ int(hashes[j])).count("1") <= bits
    ]
    pairs, away = near_pairs(hashes, bits)
    assert [tuple(pair) for pair in pairs.tolist()] == slow
    assert away.tolist() == [bin(int(hashes[i]) ^ int(hashes[j])).count("1") for i, j in slow]
    assert bits < 2 or slow


def test_low_and_high_bits_count_alike():
    one = np.uint64(1)
    hashes = np.array([0, 1, one << np.uint64(63)], np.uint64)
    assert near_pairs(hashes, 1)[0].tolist() == [[0, 1], [0, 2]]
    assert distances(hashes[:1], hashes[2:]).tolist() == [1]


@pytest.mark.parametrize("count", [0, 1])
def test_nothing_to_compare(count):
    pairs, away = near_pairs(np.zeros(count, np.uint64), 3)
    assert pairs.shape == (0, 2)
    assert away.shape == (0,)


def test_more_hashes_are_cut_so_that_more_bits_have_to_agree():
    def agree(count):
        bands, equal = _bands(count, 4)
        return 64 * equal / bands

    assert agree(10**3) <= agree(10**5) < agree(10**8)
