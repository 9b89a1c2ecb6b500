"""What a model was trained on, read from its configuration: the drawn zoo and rigged models with makers and licences."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from hydra.utils import get_object, instantiate

from fauna.data.collections import PhotoCollections
from fauna.data.sources import ZooPhotos
from fauna.errors import FaunaError
from fauna.evaluation.weights import locate
from fauna.io.checkpoint import read_weights
from fauna.models3d.catalogue import CATALOGUE, CC0, CC_BY, maker
from fauna.models3d.source import Models3D

MAY_SHIP = (CC0, CC_BY)


@dataclass(frozen=True)
class ModelFile:
    """A rigged model whose photographs were looked at.

    Attributes:
        name: stem of its file.
        species: of the animal.
        maker: who made it.
        licence: SPDX name.
    """

    name: str
    species: str
    maker: str
    licence: str


@dataclass(frozen=True)
class Provenance:
    """Everything the weights of a run have learned from.

    Attributes:
        zoo: settings of the procedural animals (``seed``, ``photos_per_species``, ``image_size``), ``None`` without them.
        photos_per_model: of each rigged model, ``None`` without them.
        trained: models whose photographs were trained on (their validation and test photographs set aside).
        held_out: models the training never saw.
    """

    zoo: Mapping[str, int] | None = None
    photos_per_model: int | None = None
    trained: tuple[ModelFile, ...] = field(default=())
    held_out: tuple[ModelFile, ...] = field(default=())


def provenance(config: Mapping[str, Any]) -> Provenance:
    """Of a run's configuration, with the paths it was trained with: the model files are listed from their folder.

    A run may have started from the weights of another, if that learned from the same photographs.

    Raises:
        FaunaError: when the run started from weights that are gone or learned from others, or learned from anything that may
            not be passed on.
    """
    if config.get("init_from") is not None:
        before = read_weights(locate(str(config["init_from"])))[1]["config"]
        if any(before["data"][key] != config["data"][key] for key in ("source", "held_out")):
            raise FaunaError(
                f"init_from: expected weights that learned from the same photographs, got {config['init_from']}, which learned "
                "from others; publish a run of one dataset"
            )
        provenance(before)
    found = Provenance()
    for source in _members(config["data"]["source"]):
        kind = get_object(source["_target_"])
        if kind is ZooPhotos:
            found = Provenance(
                {key: source[key] for key in ("seed", "photos_per_species", "image_size")},
                found.photos_per_model, found.trained, found.held_out,
            )  # fmt: skip
        elif kind is Models3D:
            trained, held_out = _model_files(source, config["data"]["held_out"])
            found = Provenance(found.zoo, source["photos_per_model"], trained, held_out)
        else:
            raise FaunaError(
                f"data.source: expected the zoo or rigged models of known licence, got {source['_target_']}; "
                "weights trained on photographs do not ship with the package"
            )
    return found


def _members(source: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    if get_object(source["_target_"]) is not PhotoCollections:
        return [source]
    return [each for member in source["members"].values() for each in _members(member)]


def _model_files(source: Mapping[str, Any], held_out: list[str]) -> tuple[tuple[ModelFile, ...], tuple[ModelFile, ...]]:
    collection: Models3D = instantiate(source, _convert_="all")
    trained, unseen = [], []
    for name, entry in sorted(collection.entries.items()):
        if name not in CATALOGUE or entry.licence not in MAY_SHIP:
            raise FaunaError(
                f"data.source.models: expected models of a known licence, got {name}.glb, which is not in the catalogue; "
                "add it to fauna.models3d.catalogue"
            )
        file = ModelFile(name, entry.species, maker(name), entry.licence)
        (unseen if entry.species in held_out or entry.family in collection.test_families else trained).append(file)
    return tuple(trained), tuple(unseen)
