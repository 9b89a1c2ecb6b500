"""One species per batch, every species equally often; any batch can be computed without the ones before it."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

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

    A batch costs the same at any number of photos, but for one permutation per species and epoch; the last two of each species
    are kept, four bytes per entry (40 MB for 10^7 photos, twice that while epochs overlap). Safe to use from several threads.

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
        self.photos = tuple(photos_per_category)
        self.back_views = tuple(back_views_per_category)
        self.entries = tuple(map(epoch_length, self.photos, self.back_views))
        self.batch_size = batch_size
        self.micro_batches = micro_batches
        self.flip_probability = flip_probability
        self.seed = seed
        self._orders: dict[tuple[int, int], Int[np.ndarray, " entry"]] = {}
        self._lock = threading.Lock()

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
        """Photos of a species' endless sequence of shuffled epochs that belong to its ``visit``-th batch."""
        first = visit * self.batch_size
        drawn: list[int] = []
        while len(drawn) < self.batch_size:
            epoch, place = divmod(first + len(drawn), self.entries[category])
            drawn += self._order(category, epoch)[place : place + self.batch_size - len(drawn)].tolist()
        photos, back_views = self.photos[category], self.back_views[category]
        return tuple(entry if entry < photos else photos + (entry - photos) % back_views for entry in drawn)

    def _order(self, category: int, epoch: int) -> Int[np.ndarray, " entry"]:
        """Entries of an epoch in their shuffled order."""
        known = self._orders.get((category, epoch))
        if known is None:
            drawn = self._permutation(self.entries[category], "photos", category, epoch)
            known = drawn.astype(np.int32 if len(drawn) < 2**31 else np.int64)
            with self._lock:
                kept = [key for key in self._orders if key[0] == category]
                for key in kept[: max(len(kept) - 1, 0)]:
                    del self._orders[key]
                self._orders[category, epoch] = known
        return known

    def _permutation(self, length: int, *purpose: int | str) -> Int[np.ndarray, " length"]:
        return np.random.default_rng(derive_seed(self.seed, *purpose)).permutation(length)


def epoch_length(num_photos: int, num_back_views: int) -> int:
    """Entries of one epoch of a species: each photo once, then the back views in turn, ``4 * floor(num_photos / 5)`` times.

    >>> epoch_length(11, 3), epoch_length(11, 0)
    (19, 11)
    """
    return num_photos + (4 * (num_photos // 5) if num_back_views else 0)
