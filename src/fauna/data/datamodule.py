"""The data module: batches as a pure function of (seed, step), validation photos one by one."""

import hashlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

import torch
from lightning import LightningDataModule
from rich.progress import track
from torch import Tensor

from fauna.data.fauna_folder import CategoryPhotos
from fauna.data.feature_cache import default_cache_root
from fauna.data.photo_loader import PhotoLoader
from fauna.data.photos import Photo
from fauna.data.prefetch import PreparedBatches
from fauna.data.screening import screen_categories
from fauna.data.sources import PhotoCollection
from fauna.data.species_sampler import SpeciesSampler
from fauna.data.splits import SplitSize, complete_splits, taking_turns
from fauna.encoder.base import Encoder
from fauna.errors import FaunaError
from fauna.random import derive_seed
from fauna.threads import in_background
from fauna.types import Batch, Features

Split = Literal["train", "val", "test", "held_out"]


class PhotoDataModule(LightningDataModule):
    """Photos of many species for training, validation and reports.

    Args:
        encoder: frozen encoder the batches are made for.
        source: lists the photos.
        root: dataset folder, as given to the source; ``None`` for sources without one.
        split: the split that validation and ``fauna-eval`` look at.
        split_file: where the choice of validation and test photos is stored; ``None`` = the user's cache folder.
        split_seed: of that choice; independent of the run's seed.
        val_fraction: share of a species set aside for validation when the dataset has no such split ...
        val_max: ... and at most so many photos.
        test_fraction: the same for the test split.
        test_max: the same.
        held_out: species never trained on.
        batch_size: photos of one micro-batch, all of one species.
        accumulate: micro-batches per optimiser step and process.
        image_size: render resolution, pixels.
        flip_probability: of mirroring a photo.
        valid_margin: strip along the original photo's border that is not trusted, crop widths.
        on_bad: ``skip`` reads every photo once before training and leaves bad ones out, by name and reason;
            ``error`` stops at the first bad photo when it is needed.
        cache_features: keep frozen features on disk.
        memory_megabytes: budget for decoded photos and prepared steps in memory.
        fit_photos: training photos that the feature space is fitted on.
        fill_workers: threads that read photos and compute features side by side before training, ``None`` = one per core.
        prefetch_steps: steps prepared ahead of the training thread, fewer if they would take more than half of
            ``memory_megabytes``; 0 prepares each step when it is needed. Batches do not depend on it.
        prefetch_workers: threads that prepare them, ``None`` = one for every two cores, at most 8.
    """

    def __init__(
        self,
        *,
        encoder: Encoder,
        source: PhotoCollection,
        root: str | None,
        split: Split,
        split_file: str | None,
        split_seed: int,
        val_fraction: float,
        val_max: int,
        test_fraction: float,
        test_max: int,
        held_out: list[str],
        batch_size: int,
        accumulate: int,
        image_size: int,
        flip_probability: float,
        valid_margin: float,
        on_bad: Literal["skip", "error"],
        cache_features: bool,
        memory_megabytes: int,
        fit_photos: int,
        fill_workers: int | None,
        prefetch_steps: int,
        prefetch_workers: int | None,
    ) -> None:
        super().__init__()
        self.source = source
        self.split: Split = split
        self.split_file = split_file
        self.split_seed = split_seed
        self.sizes = SplitSize(val_fraction, val_max), SplitSize(test_fraction, test_max)
        self.held_out = list(held_out)
        self.batch_size = batch_size
        self.accumulate = accumulate
        self.flip_probability = flip_probability
        self.on_bad: Literal["skip", "error"] = on_bad
        self.fit_photos = fit_photos
        cores = os.cpu_count() or 1
        self.fill_workers = fill_workers or min(cores, 16)
        self.prefetch_workers = prefetch_workers or min(max(cores // 2, 1), 8)
        self.loader = PhotoLoader(
            encoder=encoder,
            image_size=image_size,
            valid_margin=valid_margin,
            cache_features=cache_features,
            memory_megabytes=memory_megabytes,
        )
        self.ahead = self.loader.reserve(prefetch_steps, photos=batch_size * accumulate)
        self.by_category: dict[str, CategoryPhotos] = {}
        self.seed = 0
        self.numbered: list[str] | None = None
        self._digest = ""

    @property
    def split_path(self) -> Path:
        """Where the choice of validation and test photos is stored."""
        stored = default_cache_root() / "splits" / f"{self.source.identity}.json"
        return Path(self.split_file) if self.split_file else stored

    def prepare(self, *, seed: int, report: Callable[[str], None]) -> None:
        """List, split and check the photos.

        Args:
            seed: of the run.
            report: receives one line about what was found.

        Raises:
            FaunaError: when the dataset is missing, empty, or (``on_bad=error``) broken.
        """
        self.seed = seed
        cache, identity = default_cache_root(), self.source.identity
        listed = self.source.categories()
        if self.source.left_out:
            name, reason = self.source.left_out[0]
            report(f"{self.source.identity}: left out {len(self.source.left_out)} annotations, first {name}: {reason}")
        if self.on_bad == "skip":
            listed = screen_categories(
                listed,
                size=self.loader.image_size,
                valid_margin=self.loader.valid_margin,
                index=cache / "screened" / f"{identity}.txt",
                workers=self.fill_workers,
            )
        val, test = self.sizes
        self.by_category = complete_splits(
            listed, path=self.split_path, seed=self.split_seed, val=val, test=test, held_out=self.held_out
        )
        names = "\n".join(photo.name for each in self.by_category.values() for photo in each.train + each.back_views)
        self._digest = hashlib.blake2b(names.encode(), digest_size=8).hexdigest()
        counts = {name: len(self.photos(name)) for name in ("train", "val", "test", "held_out")}
        described = ", ".join(f"{count} {name}" for name, count in counts.items())
        report(f"{self.source.identity}: {len(self.train_species)} training species; photos: {described}")
        empty = sorted(set(self.by_category) - set(self.train_species) - set(self.held_out))
        if empty and self.train_species:
            report(f"species without usable training photos, left out: {', '.join(empty)}")

    def check_trainable(self) -> None:
        """Raises FaunaError unless there are training photos and every one has a mask."""
        if not self.train_species:
            raise FaunaError("data: expected at least one species with training photos, got none; check data.held_out")
        entries = [photo for each in self.by_category.values() for photo in each.train + each.back_views]
        boxed = [photo.name for photo in entries if photo.source.mask_source == "box"]
        if boxed:
            raise FaunaError(
                f"data: expected masks to train on, got only boxes for {len(boxed)} of {len(entries)} photos ({boxed[0]}, ...); "
                "use this dataset with fauna-eval, or train on one with masks"
            )

    @property
    def train_species(self) -> list[str]:
        """Species with training photos."""
        return [name for name, photos in self.by_category.items() if photos.train]

    def photos_digest(self) -> str:
        """Digest of the names of all training photos: with other photos the same seed gives other batches."""
        return self._digest

    def number_species(self, names: list[str]) -> None:
        """Category indices as the weights know them; species they were not trained on have none."""
        self.numbered = list(names)

    def photos(self, split: Split) -> list[Photo]:
        """Photos of a split, taking turns between species so that any first few are balanced."""
        if split == "held_out":
            lists = [self.by_category[name].test for name in self.held_out]
        else:
            lists = [getattr(photos, split) for name, photos in self.by_category.items() if name not in self.held_out]
        return taking_turns(lists)

    def single(self, photo: Photo) -> Batch:
        """A batch of one photo, as at test time."""
        species = self.train_species if self.numbered is None else self.numbered
        category = species.index(photo.category) if photo.category in species else None
        return self.loader.batch([photo], [False], category)

    def preview_photos(self, number: int) -> list[Batch]:
        """Photos of the chosen split (or training photos when it is empty), fixed by the split's order."""
        chosen = self.photos(self.split) or self.photos("train")
        return [self.single(photo) for photo in chosen[:number]]

    def feature_samples(self) -> Iterator[tuple[Features, Tensor]]:
        """Raw features and masks of at most ``fit_photos`` training photos in a seeded order, species taking turns."""
        photos = self.photos("train")
        if len(photos) > self.fit_photos:
            species = len(self.train_species)
            turns = -(-self.fit_photos // species) * species
            photos = photos[: max(turns, self.fit_photos)]
            order = torch.randperm(len(photos), generator=torch.Generator().manual_seed(derive_seed(self.seed, "fit")))
            photos = [photos[int(place)] for place in order[: self.fit_photos]]
        self.fill(photos)
        workers = self.fill_workers
        yield from in_background(self.loader.sample, photos, workers=workers, ahead=2 * workers)

    def fill(self, photos: list[Photo]) -> None:
        """Draw or decode photos and compute their features on all cores, with a progress bar; only what is missing."""
        cache = self.loader.features
        if cache is None or not (todo := cache.missing(photos)):
            return
        described = f"features of {len(todo)} photos (once; kept in {cache.folder.parent.parent})"
        for _ in track(cache.fill(todo, workers=self.fill_workers), description=described, total=len(todo)):
            pass

    def step_batches(self, step: int, sampler: SpeciesSampler, rank: int) -> list[Batch]:
        """Micro-batches of one process at one step; called from several threads."""
        return [self._planned(sampler, step, rank * self.accumulate + place) for place in range(self.accumulate)]

    def train_dataloader(self) -> PreparedBatches:
        """One item per step, starting at the trainer's step, so that a resumed run goes on where it stopped."""
        trainer = self.trainer
        assert trainer is not None
        pools = [self.by_category[name] for name in self.train_species]
        sampler = SpeciesSampler(
            photos_per_category=[len(pool.train) for pool in pools],
            back_views_per_category=[len(pool.back_views) for pool in pools],
            batch_size=self.batch_size,
            micro_batches=self.accumulate * trainer.world_size,
            flip_probability=self.flip_probability,
            seed=self.seed,
        )

        def make(step: int) -> list[Batch]:
            return self.step_batches(step, sampler, trainer.global_rank)

        return PreparedBatches(make, lambda: trainer.global_step, trainer.max_steps, self.prefetch_workers, self.ahead)

    def val_dataloader(self) -> PreparedBatches:
        """Photos of the chosen split, one a batch."""
        photos = self.photos(self.split)

        def make(place: int) -> list[Batch]:
            return [self.single(photos[place])]

        return PreparedBatches(make, lambda: 0, len(photos), self.prefetch_workers, self.ahead)

    def transfer_batch_to_device(self, batch: list[Batch], device: torch.device, dataloader_idx: int) -> list[Batch]:
        """Lightning cannot look into frozen dataclasses."""
        return [micro.to(device) for micro in batch]

    def _planned(self, sampler: SpeciesSampler, step: int, index: int) -> Batch:
        plan = sampler.batch(step, index)
        pool = self.by_category[self.train_species[plan.category]]
        first = len(pool.train)
        photos = [pool.train[place] if place < first else pool.back_views[place - first] for place in plan.photos]
        return self.loader.batch(photos, plan.flips, plan.category)
