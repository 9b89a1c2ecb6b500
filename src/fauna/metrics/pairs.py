"""Which pairs of photos are compared, and which keypoints mirror each other."""

import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from fauna.random import derive_seed

OTHER_SIDE = {"left": "right", "Left": "Right", "L": "R", "l": "r"}
OTHER_SIDE |= {right: left for left, right in OTHER_SIDE.items()}


def ordered_pairs(names: Sequence[str], *, count: int, seed: int) -> Int[np.ndarray, "pair 2"]:
    """Ordered (source, target) pairs of different photos, drawn without repetition: a pure function of seed and set of names.

    Args:
        names: of the photos of one species, unique.
        count: how many pairs are drawn; all of them if there are not more.
        seed: of the draw.

    Returns:
        Indices into ``names``.

    >>> ordered_pairs(["b", "a"], count=10, seed=0).tolist()
    [[1, 0], [0, 1]]
    """
    by_name = np.array(sorted(range(len(names)), key=names.__getitem__), dtype=np.int64)
    number = len(names)
    total = number * (number - 1)
    if total > count:  # ``choice`` never holds more than fifty times as many numbers as it draws
        rng = np.random.default_rng(derive_seed(seed, "pairs"))
        code = np.sort(rng.choice(total, size=count, replace=False))
    else:
        code = np.arange(total)
    source, target = np.divmod(code, max(number - 1, 1))
    target = target + (target >= source)
    return np.stack([by_name[source], by_name[target]], axis=1)


def mirror_map(names: Sequence[str]) -> Int[np.ndarray, " key"]:
    """For each keypoint its counterpart on the other side, itself where its name has none.

    >>> mirror_map(("nose", "left_eye", "right_eye", "left_tusk")).tolist()
    [0, 2, 1, 3]
    """
    place = {name: index for index, name in enumerate(names)}
    return np.array([place.get(_mirrored(name), index) for index, name in enumerate(names)], dtype=np.int64)


def _mirrored(name: str) -> str:
    """The name with its words for a side exchanged: ``left_eye``, ``L_F_Paw``, ``Eye_Left``."""
    return re.sub("[A-Za-z]+", lambda word: OTHER_SIDE.get(word[0], word[0]), name)
