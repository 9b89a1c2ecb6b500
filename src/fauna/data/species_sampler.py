"""One species per batch, every species equally often; any batch can be computed without the ones before it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fauna.errors import FaunaError
from fauna.random import derive_seed


@dataclass(frozen=True)
class BatchPlan:
    """What one micro-batch consists of.

    Attributes:
        category: index of the species.
        photos: indices into the species' photos; back views follow the ordinary ones, at ``photos_per_category[category]`` and up.
        flips: whether each photo is mirrored.
    """

    category: int
    photos: tuple[int, ...]
    flips: tuple[bool, ...]


class SpeciesSampler:
    """A pure function from (step, micro-batch) to a :class:`BatchPlan` (3D-Fauna supplement, batches of one species).

    * Micro-batches are numbered ``step * micro_batches + index``. Each run of as many micro-batches as there are species visits
      every species once, in an order drawn anew for each run.
    * Within a species photos are drawn without replacement, epoch after epoch; a batch may straddle two epochs, and species with
      fewer photos than ``batch_size`` repeat theirs.
    * Back views, if a species has any, are repeated to ``4 * floor(n / 5)`` entries of an epoch beside its n photos.

    Args:
        photos_per_category: number of ordinary photos of each species, all positive.
        back_views_per_category: number of back views of each species, 0 for none.
        batch_size: photos per micro-batch.
        micro_batches: micro-batches per step (processes times accumulation).
        flip_probability: probability that a photo is mirrored.
        seed: of the run.

    Raises:
        FaunaError: if there is no species or one without photos.
    """

    def __init__(
        self,
        *,
        photos_per_category: Sequence[int],
        back_views_per_category: Sequence[int],
        batch_size: int,
        micro_batches: int,
        flip_probability: float,
        seed: int,
    ):
        if (
            not photos_per_category
            or min(photos_per_category) < 1
            or len(back_views_per_category) != len(photos_per_category)
        ):
            raise FaunaError(
                f"species sampler expects at least one photo for each species, got photos {list(photos_per_category)[:10]} "
                f"and back views {list(back_views_per_category)[:10]}; leave empty species out"
            )
        if batch_size < 1 or micro_batches < 1:
            raise FaunaError(
                f"species sampler expects positive sizes, got batch_size={batch_size}, micro_batches={micro_batches}"
            )
        self.entries = tuple(map(epoch_entries, photos_per_category, back_views_per_category))
        self.batch_size = batch_size
        self.micro_batches = micro_batches
        self.flip_probability = flip_probability
        self.seed = seed

    def batch(self, step: int, index: int = 0) -> BatchPlan:
        """The plan of micro-batch ``index`` (in [0, micro_batches)) of step ``step``."""
        if not 0 <= index < self.micro_batches or step < 0:
            raise FaunaError(
                f"species sampler expects step >= 0 and index in [0, {self.micro_batches}), got {step} and {index}"
            )
        number = step * self.micro_batches + index
        cycle, place = divmod(number, len(self.entries))
        category = int(self._permutation(len(self.entries), "cycle", cycle)[place])
        draws = np.random.default_rng(derive_seed(self.seed, "flip", number)).random(self.batch_size)
        flips = tuple(bool(draw < self.flip_probability) for draw in draws)
        return BatchPlan(category, self._photos(category, visit=cycle), flips)

    def _photos(self, category: int, visit: int) -> tuple[int, ...]:
        """Entries of a species' endless sequence of shuffled epochs that belong to its ``visit``-th batch."""
        entries = self.entries[category]
        slots = range(visit * self.batch_size, (visit + 1) * self.batch_size)
        epochs = range(slots[0] // len(entries), slots[-1] // len(entries) + 1)
        orders = {epoch: self._permutation(len(entries), "photos", category, epoch) for epoch in epochs}
        return tuple(entries[int(orders[slot // len(entries)][slot % len(entries)])] for slot in slots)

    def _permutation(self, length: int, *purpose: int | str) -> np.ndarray:
        return np.random.default_rng(derive_seed(self.seed, *purpose)).permutation(length)


def epoch_entries(num_photos: int, num_back_views: int) -> tuple[int, ...]:
    """Photo indices of one epoch of a species: each photo once, then the back views in turn, ``4 * floor(num_photos / 5)`` times."""
    repeats = 4 * (num_photos // 5) if num_back_views else 0
    return (*range(num_photos), *(num_photos + slot % num_back_views for slot in range(repeats)))
