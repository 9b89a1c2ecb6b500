"""Which photographs an evaluation looks at."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from fauna.data.datamodule import PhotoDataModule, Split
from fauna.data.fauna_folder import CategoryPhotos
from fauna.data.photos import Photo, PhotoSource
from fauna.data.splits import taking_turns
from fauna.errors import FaunaError
from fauna.evaluation.protocol import photos_digest
from fauna.evaluation.trained_on import TrainingPhotos

SPLITS = ("all", "train", "val", "test", "held_out")
WITH_TRAINING = ("all", "train")
"""Splits that may contain photographs of the training; of the others such photographs are left out."""
SEEN, HELD_OUT = "metrics", "held_out"
"""Keys of the report that the two groups of photographs go under: species the checkpoint was trained on, and all others."""

Groups = dict[str, tuple[Photo, ...]]


@dataclass(frozen=True)
class Subjects:
    """The photographs, by group.

    Attributes:
        split: what was looked at, e.g. ``"test"`` or ``"all"``.
        groups: :data:`SEEN` and :data:`HELD_OUT`, empty ones left out; species take turns within a group.
        trained_on: names of those among them that the checkpoint was trained on.
        left_out: names of photographs that are not among them because the checkpoint was trained on them.
    """

    split: str
    groups: Mapping[str, tuple[Photo, ...]]
    trained_on: tuple[str, ...]
    left_out: tuple[str, ...]

    @property
    def photos(self) -> list[Photo]:
        """Photographs of all groups."""
        return [photo for photos in self.groups.values() for photo in photos]


def choose(
    data: PhotoDataModule,
    training: TrainingPhotos,
    *,
    split: str | None,
    given: bool,
    seed: int,
    max_photos: int | None,
) -> Subjects:
    """Choose the photographs.

    Args:
        data: not prepared yet; what it holds out becomes the species the checkpoint was not trained on.
        training: of the checkpoint.
        split: one of :data:`SPLITS`, or ``None``: every photograph of a dataset of files that was named on the command
            line; otherwise the test split, or the validation split where there is no test photo, and the held-out species.
        given: whether the dataset was named on the command line rather than taken from the checkpoint.
        seed: of the evaluation.
        max_photos: limit of each group.

    Raises:
        FaunaError: when the split is unknown, has no photographs, or only such that the checkpoint was trained on.
    """
    if split not in (None, *SPLITS):
        raise FaunaError(f"data.split: expected one of {', '.join(SPLITS)}, got {split!r}; choose one")
    listed = data.source.categories()
    data.held_out = [name for name in listed if name not in training.species]
    if split is None and given and not _rendered(listed):
        split = "all"
    if split != "all":
        data.prepare(seed=seed, report=print)
    tried = (split,) if split is not None else ("test", "val")
    left_out: list[str] = []
    for name in tried:
        groups = _groups(data, listed, name, also_held_out=split is None)
        everything = [photo for photos in groups.values() for photo in photos]
        trained_on = training.among(everything, identity=data.source.identity)
        if name not in WITH_TRAINING:
            left_out += [photo.name for photo in everything if photo.name in trained_on]
            groups = {key: tuple(p for p in photos if p.name not in trained_on) for key, photos in groups.items()}
        groups = {key: photos[:max_photos] for key, photos in groups.items() if photos}
        if SEEN in groups or (groups and name == tried[-1]):
            kept = [photo.name for photos in groups.values() for photo in photos]
            looked_at = name if SEEN in groups or split is not None else HELD_OUT
            included = tuple(each for each in kept if each in trained_on)
            return Subjects(looked_at, groups, included, tuple(dict.fromkeys(left_out)))
    raise FaunaError(_nothing(data, tried[-1], len(left_out)))


def _nothing(data: PhotoDataModule, split: str, left_out: int) -> str:
    """Why there is no photograph to look at."""
    if left_out:
        return (
            f"data.split: expected photos of {data.source.identity} that the checkpoint was not trained on, got "
            f"{left_out} of its training photos only; use data.split=all to look at them nevertheless"
        )
    return (
        f"data.split: expected a split with photos in {data.source.identity}, got {split}, which has none; "
        f"choose one of {', '.join(SPLITS)}"
    )


def dataset_facts(
    identity: str, source: Any, keys: Mapping[str, str], subjects: Subjects, training: TrainingPhotos
) -> dict[str, Any]:
    """Identity of the photographs for the protocol, and what the checkpoint has to do with them.

    Args:
        identity: of the dataset.
        source: its configuration.
        keys: of :func:`fauna.evaluation.protocol.photo_keys`.
        subjects: the photographs.
        training: of the checkpoint.
    """
    return {
        "identity": identity,
        "sha256": photos_digest(keys),
        "source": source,
        "training_photos": {
            "included": len(subjects.trained_on),
            "left_out": len(subjects.left_out),
            "unknown": training.problem,
        },
    }


def _groups(data: PhotoDataModule, listed: Mapping[str, CategoryPhotos], split: str, *, also_held_out: bool) -> Groups:
    """Photographs of a split by group."""
    if split == "all":
        names = {SEEN: [n for n in listed if n not in data.held_out], HELD_OUT: data.held_out}
        return {key: tuple(_everything(listed, species)) for key, species in names.items()}
    held_out = tuple(data.photos("held_out")) if also_held_out or split == "held_out" else ()
    return {SEEN: () if split == "held_out" else tuple(data.photos(cast(Split, split))), HELD_OUT: held_out}


def _everything(listed: Mapping[str, CategoryPhotos], species: Sequence[str]) -> list[Photo]:
    """All photographs of the species, whatever folder they lie in, species taking turns."""
    return taking_turns([listed[n].train + listed[n].val + listed[n].test + listed[n].back_views for n in species])


def _rendered(listed: Mapping[str, CategoryPhotos]) -> bool:
    """Whether the photographs are drawn and their geometry is known: then splits are by individual and species."""
    for species in listed.values():
        for photo in species.train + species.val + species.test:
            return type(photo.source).truth is not PhotoSource.truth
    return False
