"""Asks a bank about many pictures whose species is known: how a :class:`~fauna.bank.table.BankTable` is made."""

from collections.abc import Callable, Sequence

import numpy as np
import torch

from fauna.bank.table import BankTable, DrawnBy, joined
from fauna.data.feature_cache import FeatureCache
from fauna.data.photos import Photo
from fauna.data.sources import ZooSource
from fauna.errors import FaunaError
from fauna.model import FaunaModel

BLOCK = 50
"""Pictures asked about at once."""


@torch.no_grad()
def take_census(
    model: FaunaModel,
    photos: Sequence[Photo],
    *,
    trained: Sequence[bool],
    weights_sha256: str,
    report: Callable[[int], None] | None = None,
) -> BankTable:
    """Ask about every picture; features come from the cache, or are computed and kept there.

    The bank sees nothing but a picture's global feature, so neither masks nor the rest of the model are needed.

    Args:
        model: whose bank is asked.
        photos: with their species (``category``); at least one.
        trained: whether the model learned from each.
        weights_sha256: of the model's weight file.
        report: told how many pictures are done, from time to time.

    Raises:
        FaunaError: for a bank without slots, for no pictures, or when one cannot be read.
    """
    if not photos:
        raise FaunaError("bank table: expected pictures of known species, got none; choose another dataset")
    cache = FeatureCache(encoder=model.encoder, root=None)
    answers = []
    for start in range(0, len(photos), BLOCK):
        block = list(photos[start : start + BLOCK])
        features = cache.get_many(block, [False] * len(block)).to(model.device)
        readout = model.bank(model.feature_space.normalize(features).global_, 0)
        if readout.slots is None or readout.weights is None:
            raise FaunaError(
                f"bank table: expected a bank with slots, got {type(model.bank).__name__}; use weights with bank=semantic"
            )
        answers.append((readout.slots, readout.weights))
        if report is not None:
            report(start + len(block))
    slots, weights = joined(answers)
    return BankTable(
        weights_sha256,
        tuple(photo.name for photo in photos),
        tuple(photo.category for photo in photos),
        np.array(trained, dtype=bool),
        slots,
        weights.astype(np.float16).astype(np.float64),  # as it is stored
        _zoo_of(photos),
    )


def _zoo_of(photos: Sequence[Photo]) -> DrawnBy | None:
    """The zoo that drew the pictures of a bare name ``<species>/<number>``."""
    zoos = {DrawnBy(each.source.seed, each.source.image_size) for each in photos if isinstance(each.source, ZooSource)}
    if len(zoos) > 1:
        raise FaunaError("bank table: expected pictures of one zoo, got several seeds or sizes; choose one")
    return zoos.pop() if zoos else None
