"""Which photographs a checkpoint was trained on: its training split, found again from the configuration saved with it."""

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from hydra.errors import HydraException
from hydra.utils import instantiate
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from fauna.cli import user_message
from fauna.data.datamodule import PhotoDataModule
from fauna.data.photos import Photo, PhotoSource
from fauna.encoder.base import Encoder
from fauna.errors import FaunaError
from fauna.threads import in_background

REASON = "the checkpoint was trained on it, or on another photograph of the same individual"


@dataclass(frozen=True)
class TrainingPhotos:
    """The training split of a checkpoint.

    Attributes:
        species: names of the species it was trained on.
        identity: of the dataset, ``None`` when the split could not be found again.
        photos: that were trained on, back views among them.
        problem: why the split could not be found again, ``None`` if it was.
    """

    species: tuple[str, ...]
    identity: str | None
    photos: tuple[Photo, ...]
    problem: str | None

    def among(self, photos: Sequence[Photo], *, identity: str) -> set[str]:
        """Names of the photos that were trained on, and of those that show the same individual or photograph.

        In the dataset of the training the names of individuals and photographs tell; in any other the drawn individual or the
        bytes of the file do (:meth:`fauna.data.photos.PhotoSource.pictured`), and what is true of one crop of a photograph is
        true of its others.

        Args:
            photos: of one dataset.
            identity: of that dataset.
        """
        if identity == self.identity:
            known = {photo.photograph for photo in self.photos}
            return {photo.name for photo in photos if photo.photograph in known}
        if not self.photos:
            return set()
        trained = set(_pictured(self.photos))
        pairs = zip(photos, _pictured(photos), strict=True)
        seen = {photo.photograph for photo, pictured in pairs if pictured is not None and pictured in trained}
        return {photo.name for photo in photos if photo.photograph in seen}


def training_photos(config: DictConfig, species: Sequence[str], encoder: Encoder) -> TrainingPhotos:
    """Split the dataset of a training once more, as the training did.

    Args:
        config: saved with the weights, not changed.
        species: saved with the weights.
        encoder: of the configuration; not asked for anything.
    """
    try:
        data: PhotoDataModule = instantiate(config.data, _convert_="all", _partial_=True)(encoder=encoder)
        if data.split_path.is_file():
            data.on_bad = "error"  # the stored choice stands; nothing has to be read for it
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            data.prepare(seed=config.seed, report=lambda line: None)
    except (FaunaError, HydraException, OmegaConfBaseException) as error:
        reason = user_message(error, "fauna-train") or f"{type(error).__name__} while its dataset was opened"
        return TrainingPhotos(tuple(species), None, (), reason)
    lists = [each.train + each.back_views for each in data.by_category.values()]
    return TrainingPhotos(tuple(species), data.source.identity, tuple(p for each in lists for p in each), None)


def _pictured(photos: Iterable[Photo]) -> list[str | None]:
    """What each photo shows; ``None`` for files that cannot be read."""
    sources = [photo.source for photo in photos]
    return list(in_background(_asked, sources, workers=8, ahead=64))


def _asked(source: PhotoSource) -> str | None:
    try:
        return source.pictured()
    except FaunaError:
        return None
