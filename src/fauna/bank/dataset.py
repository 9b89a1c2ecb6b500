"""Pictures of known species to ask a bank about: those it learned from, or those of any dataset."""

from collections.abc import Sequence
from pathlib import Path

from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from fauna._conf import CONF_DIR
from fauna.build import build_encoder, stored_config
from fauna.data.photos import Photo
from fauna.data.sources import PhotoCollection, ZooPhotos, ZooSource
from fauna.errors import FaunaError
from fauna.evaluation.trained_on import training_photos
from fauna.io.checkpoint import read_weights


def pictures_of(data: Sequence[str], weights: Path, *, most: int) -> tuple[list[Photo], list[bool]]:
    """Pictures of a dataset, evenly from all that it has of each species.

    Args:
        data: overrides of the configuration, e.g. ``data=fauna``, ``data.root=FOLDER``.
        weights: whose species count as learned.
        most: pictures of a species.

    Returns:
        Pictures, and whether the weights learned from their species.

    Raises:
        FaunaError: when the dataset cannot be read, or ``most`` is below 1.
    """
    if most < 1:
        raise FaunaError(f"--photos: expected a number >= 1, got {most}; e.g. 24")
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        cfg = compose("train", overrides=list(data))
    source: PhotoCollection = instantiate(cfg.data.source, _convert_="all")
    learned = set(read_weights(weights)[1]["species"])
    photos: list[Photo] = []
    for each in source.categories().values():
        photos += _evenly([*each.train, *each.val, *each.test], most)
    return photos, [photo.category in learned for photo in photos]


def training_pictures(weights: Path, overrides: Sequence[str], *, held_out: int) -> tuple[list[Photo], list[bool]]:
    """The training split of a weight file, and pictures of species that the same zoo holds besides.

    Args:
        weights: with the configuration of its training.
        overrides: of that configuration, where places of files are missing, e.g. ``data.root=FOLDER``.
        held_out: pictures of each further species.

    Returns:
        Pictures, and whether the weights learned from them.

    Raises:
        FaunaError: when the training split cannot be found again, or an override does not fit.
    """
    metadata = read_weights(weights)[1]
    stored = stored_config(metadata["config"])
    for override in overrides:
        _override(stored, override)
    found = training_photos(stored, metadata["species"], build_encoder(stored))
    if found.problem is not None:
        raise FaunaError(f"{found.problem} (of the training's data: give missing places as KEY=VALUE)")
    photos = list(found.photos)
    others: list[Photo] = []
    zoos = {(each.source.seed, each.source.image_size) for each in photos if isinstance(each.source, ZooSource)}
    if len(zoos) == 1 and held_out > 0:
        (seed, size), learned = zoos.pop(), set(found.species)
        zoo = ZooPhotos(seed=seed, photos_per_species=4 * held_out, image_size=size, species=None).categories()
        others = [photo for kind, each in zoo.items() if kind not in learned for photo in each.train[::4]]
    return [*photos, *others], [True] * len(photos) + [False] * len(others)


def _evenly(photos: Sequence[Photo], most: int) -> list[Photo]:
    count = min(most, len(photos))
    return [photos[number * len(photos) // count] for number in range(count)]


def _override(cfg: DictConfig, text: str) -> None:
    key, equals, value = text.partition("=")
    parent = OmegaConf.select(cfg, key.rpartition(".")[0]) if "." in key else None
    if not equals or not isinstance(parent, DictConfig) or key.rpartition(".")[2] not in parent:
        raise FaunaError(f"{text}: expected KEY=VALUE of the training's configuration, got none; e.g. data.root=FOLDER")
    OmegaConf.update(cfg, key, value)
