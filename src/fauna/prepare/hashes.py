"""Pairs of nearly equal 64-bit hashes among many, without comparing all with all."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Int, UInt8, UInt64

BITS = 64
_ONES: UInt8[np.ndarray, " byte"] = np.array([bin(byte).count("1") for byte in range(256)], np.uint8)


def near_pairs(
    hashes: UInt64[np.ndarray, " hash"], bits: int
) -> tuple[Int[np.ndarray, "pair 2"], Int[np.ndarray, " pair"]]:
    """All pairs that differ in at most ``bits`` bits.

    The hashes are cut into ``bands`` pieces; of two that differ in ``bits`` bits at least ``bands - bits`` pieces are equal, so that
    only hashes that agree in some choice of so many pieces are compared. The number of pieces is the one with the least work.

    Args:
        hashes: all different.
        bits: in [0, 15].

    Returns:
        Indices of the pairs, the smaller first, in rising order; and their distances.
    """
    found = [np.empty((0, 2), np.int64)]
    if bits > 0 and len(hashes) > 1:
        for mask in _masks(*_bands(len(hashes), bits)):
            found += _equal_under(hashes, np.uint64(mask), bits)
    pairs = np.unique(np.concatenate(found), axis=0)
    return pairs, distances(hashes[pairs[:, 0]], hashes[pairs[:, 1]])


def distances(first: UInt64[np.ndarray, " pair"], second: UInt64[np.ndarray, " pair"]) -> Int[np.ndarray, " pair"]:
    """Number of bits that differ."""
    differ = np.ascontiguousarray(first ^ second).view(np.uint8).reshape(-1, 8)
    return _ONES[differ].sum(axis=1, dtype=np.int64)


def _bands(count: int, bits: int) -> tuple[int, int]:
    """Pieces, and how many of them have to be equal, with the least work for hashes that are spread evenly."""

    def work(bands: int) -> float:
        equal = bands - bits
        pairs = 0.5 * count**2 / 2.0 ** (BITS * equal / bands)
        return math.comb(bands, equal) * (count * math.log2(count) + pairs)

    bands = min(range(bits + 1, min(2 * bits + 3, 21)), key=work)
    return bands, bands - bits


def _masks(bands: int, equal: int) -> Iterator[int]:
    edges = [round(BITS * band / bands) for band in range(bands + 1)]
    pieces = [(1 << stop) - (1 << start) for start, stop in itertools.pairwise(edges)]
    for chosen in itertools.combinations(pieces, equal):
        yield sum(chosen)


def _equal_under(hashes: UInt64[np.ndarray, " hash"], mask: np.uint64, bits: int) -> list[Int[np.ndarray, "pair 2"]]:
    """Pairs that agree under the mask and are near."""
    keys = hashes & mask
    order = np.argsort(keys, kind="stable")
    keys, sorted_hashes = keys[order], hashes[order]
    found = []
    for shift in range(1, len(keys)):
        (same,) = np.nonzero(keys[shift:] == keys[:-shift])
        if not len(same):
            break
        near = same[distances(sorted_hashes[same], sorted_hashes[same + shift]) <= bits]
        found.append(np.sort(np.stack([order[near], order[near + shift]], axis=1), axis=1))
    return found
