"""Which photographs an evaluation looks at."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from fauna.data.datamodule import PhotoDataModule, Split
from fauna.data.fauna_folder import CategoryPhotos
from fauna.data.photos import Photo, PhotoSource
from fauna.errors import FaunaError

SPLITS = ("all", "train", "val", "test", "held_out")
SEEN, HELD_OUT = "metrics", "held_out"
"""Keys of the report that the two groups of photographs go under."""


@dataclass(frozen=True)
class Subjects:
    """The photographs, by group.

    Attributes:
        split: what was looked at, e.g. ``"test"`` or ``"all"``.
        groups: ``metrics`` and, where species were held out, ``held_out``; species take turns within a group.
    """

    split: str
    groups: Mapping[str, tuple[Photo, ...]]

    @property
    def photos(self) -> list[Photo]:
        """Photographs of all groups."""
        return [photo for photos in self.groups.values() for photo in photos]


def choose(data: PhotoDataModule, *, split: str | None, given: bool, seed: int, max_photos: int | None) -> Subjects:
    """Choose the photographs.

    Args:
        data: not prepared yet.
        split: one of :data:`SPLITS`, or ``None``: every photograph of a dataset of files that was named on the command
            line; otherwise the test split, or the validation split where there is no test photo, and the held-out species.
        given: whether the dataset was named on the command line rather than taken from the checkpoint.
        seed: of the evaluation.
        max_photos: limit of each group.

    Raises:
        FaunaError: when the split is unknown or has no photographs.
    """
    if split not in (None, *SPLITS):
        raise FaunaError(f"data.split: expected one of {', '.join(SPLITS)}, got {split!r}; choose one")
    if split == "all" or (split is None and given and not _rendered(data)):
        listed = data.source.categories()
        groups = {SEEN: _turns(listed, exclude=data.held_out), HELD_OUT: _turns(listed, only=data.held_out)}
        split = "all"
    else:
        data.prepare(seed=seed, report=print)
        if split is None:
            split = "test" if data.photos("test") else "val"
            groups = {SEEN: tuple(data.photos(cast(Split, split))), HELD_OUT: tuple(data.photos("held_out"))}
        else:
            groups = {SEEN: tuple(data.photos(cast(Split, split)))}
    groups = {name: photos[:max_photos] for name, photos in groups.items() if photos}
    if not groups:
        raise FaunaError(
            f"data.split: expected a split with photos in {data.source.identity}, got {split}, which has none; "
            f"choose one of {', '.join(SPLITS)}"
        )
    return Subjects(split, groups)


def _rendered(data: PhotoDataModule) -> bool:
    """Whether the photographs are drawn and their geometry is known: then splits are by individual and species."""
    for species in data.source.categories().values():
        for photo in species.train + species.val + species.test:
            return type(photo.source).truth is not PhotoSource.truth
    return False


def _turns(
    listed: Mapping[str, CategoryPhotos], *, only: Sequence[str] | None = None, exclude: Sequence[str] = ()
) -> tuple[Photo, ...]:
    """All photographs of the species, whatever folder they lie in, species taking turns."""
    chosen = [name for name in listed if name not in exclude and (only is None or name in only)]
    lists = [listed[n].train + listed[n].val + listed[n].test + listed[n].back_views for n in chosen]
    longest = max(map(len, lists), default=0)
    return tuple(each[turn] for turn in range(longest) for each in lists if turn < len(each))
