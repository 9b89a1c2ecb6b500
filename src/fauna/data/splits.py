"""Validation and test photos for categories that come without them, chosen by photograph and remembered in a file."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fauna.data.fauna_folder import CategoryPhotos
from fauna.data.feature_cache import write_atomically
from fauna.data.photos import Photo
from fauna.errors import FaunaError
from fauna.random import derive_seed

FORMAT = 1


@dataclass(frozen=True)
class SplitSize:
    """How many photos of a category are set aside: ``round(fraction * n)``, at most ``maximum``.

    Attributes:
        fraction: of the category's photos.
        maximum: upper limit (5 for the few-shot categories of 3D-Fauna).
    """

    fraction: float
    maximum: int

    def of(self, num_photos: int) -> int:
        """Number of photos to set aside."""
        return min(round(self.fraction * num_photos), self.maximum)


def complete_splits(
    categories: Mapping[str, CategoryPhotos],
    *,
    path: Path | None,
    seed: int,
    val: SplitSize,
    test: SplitSize,
    held_out: Sequence[str],
) -> dict[str, CategoryPhotos]:
    """Set validation and test photos aside where a category has none, and take held-out species out of training.

    All crops of one photograph go to the same split, across categories, so a split may get a few photos more than asked for. The
    choice depends on the seed and the names only. It is stored at ``path`` and reused: later runs keep the photographs named there,
    new photographs of a known category go to training, and a new category is split without touching the known ones.

    Args:
        categories: as read; splits that are not empty are kept.
        path: JSON file, made if missing; ``None`` stores nothing.
        seed: of the choice.
        val: size of the validation split.
        test: size of the test split.
        held_out: species never trained on; all their photos become test photos.

    Raises:
        FaunaError: if a held-out species does not exist, or the file is broken or made with other settings.
    """
    unknown = sorted(set(held_out) - set(categories))
    if unknown:
        raise FaunaError(
            f"held-out species expects names among {sorted(categories)[:12]}, got {unknown}; mend data.held_out"
        )
    settings = {"seed": seed, "val": [val.fraction, val.maximum], "test": [test.fraction, test.maximum]}
    stored = _load(path, settings) if path is not None and path.exists() else {"val": {}, "test": {}}
    trainable = {name: photos for name, photos in sorted(categories.items()) if name not in held_out}
    chosen = {split: dict(names) for split, names in stored.items()}
    for split, size in (("test", test), ("val", val)):
        _choose(trainable, chosen, split, size, seed, known=set(stored["val"]) | set(stored["test"]))
    if path is not None and chosen != stored:
        text = json.dumps({"format": FORMAT, "settings": settings, **chosen}, indent=1, sort_keys=True)
        write_atomically(path, text.encode())
    result = {name: _apply(photos, chosen) for name, photos in trainable.items()}
    for name in held_out:
        photos = categories[name]
        everything = photos.train + photos.back_views + photos.val + photos.test
        result[name] = CategoryPhotos(name, train=(), val=(), test=everything)
    return dict(sorted(result.items()))


def taking_turns(lists: Sequence[Sequence[Photo]]) -> list[Photo]:
    """The first of every list, then the second of every list that has one, and so on: any first few are balanced."""
    longest = max(map(len, lists), default=0)
    return [each[turn] for turn in range(longest) for each in lists if turn < len(each)]


def _choose(
    categories: Mapping[str, CategoryPhotos],
    chosen: dict[str, dict[str, list[str]]],
    split: str,
    size: SplitSize,
    seed: int,
    known: set[str],
) -> None:
    """Add photographs to ``chosen[split]`` for every category that is new and has no such split of its own."""
    fixed = {photo.photograph for name in known & set(categories) for photo in categories[name].train}
    taken = _union(chosen)
    for name, photos in categories.items():
        if name in known or getattr(photos, split):
            continue
        own = _union({split: chosen[split]})
        wanted = size.of(len(photos.train)) - sum(photo.photograph in own for photo in photos.train)
        counts: dict[str, int] = {}
        for photo in photos.train:
            counts[photo.photograph] = counts.get(photo.photograph, 0) + 1
        free = sorted(set(counts) - fixed - taken)
        order = np.random.default_rng(derive_seed(seed, split, name)).permutation(len(free))
        picked: list[str] = []
        for place in order[: max(len(free) - 1, 0)]:  # one photograph always stays for training
            if wanted <= 0:
                break
            picked.append(free[place])
            wanted -= counts[free[place]]
        chosen[split][name] = sorted(picked)
        taken.update(picked)


def _apply(photos: CategoryPhotos, chosen: Mapping[str, Mapping[str, Iterable[str]]]) -> CategoryPhotos:
    """Move the chosen photographs out of training, wherever they were chosen; back views of them are dropped."""
    val, test = _union({"val": chosen["val"]}), _union({"test": chosen["test"]})

    def pick(pool: tuple[Photo, ...], names: set[str]) -> tuple[Photo, ...]:
        return tuple(photo for photo in pool if photo.photograph in names)

    rest = {photo.photograph for photo in photos.train + photos.back_views} - val - test
    return replace(
        photos,
        train=pick(photos.train, rest),
        val=photos.val + pick(photos.train, val),
        test=photos.test + pick(photos.train, test - val),
        back_views=pick(photos.back_views, rest),
    )


def _union(chosen: Mapping[str, Mapping[str, Iterable[str]]]) -> set[str]:
    return {photograph for names in chosen.values() for photographs in names.values() for photograph in photographs}


def _load(path: Path, settings: dict) -> dict[str, dict[str, list[str]]]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        stored_settings, chosen = content["settings"], {split: content[split] for split in ("val", "test")}
        sound = content["format"] == FORMAT and all(
            isinstance(names, list) for split in chosen.values() for names in split.values()
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FaunaError(
            f"{path} expects a split file of format {FORMAT}, got a broken one ({error}); delete it"
        ) from error
    if not sound:
        raise FaunaError(f"{path} expects a split file of format {FORMAT}, got another one; delete it")
    if stored_settings != settings:
        raise FaunaError(
            f"{path} expects the settings it was made with, {stored_settings}, got {settings}; restore them or choose another file"
        )
    return chosen
