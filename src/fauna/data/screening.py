"""Every photo is read once before training; what was read is remembered, so that the next start does not read it again."""

import hashlib
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from rich.progress import track

from fauna.data.fauna_folder import CategoryPhotos
from fauna.data.feature_cache import write_atomically
from fauna.data.photos import Photo, load_photo
from fauna.errors import FaunaError
from fauna.threads import in_background

LISTS = ("train", "val", "test", "back_views")  # of CategoryPhotos
USABLE = "usable"
CHECKS = "v1"  # part of the key; to be changed with what load_photo refuses
STORE_SECONDS = 10.0
SHOW_FROM = 500  # photos from which a progress bar is worth its line


@dataclass(frozen=True)
class Screening:
    """Result of :func:`screen_photos`.

    Attributes:
        photos: the usable photos, in their order.
        rejected: (name, reason) of the others.
    """

    photos: tuple[Photo, ...]
    rejected: tuple[tuple[str, str], ...]


def screen_photos(
    photos: Sequence[Photo],
    *,
    size: int,
    valid_margin: float,
    on_bad: Literal["skip", "error"],
    index: Path | None,
    workers: int,
) -> Screening:
    """Read every photo once, so that no bad file can interrupt or silently change a training run.

    Args:
        photos: the photos to check.
        size: resolution at which masks must not vanish, pixels.
        valid_margin: see :func:`fauna.data.photos.load_photo`.
        on_bad: ``"error"`` raises for the first bad photo; ``"skip"`` leaves bad ones out and warns once with their names.
        index: file that remembers verdicts; a photo is read again when the path, size or time of one of its files changes.
            An interrupted screening goes on where it was. ``None`` remembers nothing.
        workers: threads that read side by side.

    Raises:
        FaunaError: for a bad photo under ``"error"``, and when no photo is left.
    """
    verdicts = _verdicts(photos, size, valid_margin, index, workers)
    good = tuple(photo for photo, verdict in zip(photos, verdicts, strict=True) if verdict == USABLE)
    rejected = [(photo.name, verdict) for photo, verdict in zip(photos, verdicts, strict=True) if verdict != USABLE]
    if rejected and on_bad == "error":
        raise FaunaError(rejected[0][1])
    if rejected and not good:
        raise FaunaError(
            f"expected at least one usable photo of {len(photos)}, got none; first problem: {rejected[0][1]}"
        )
    if rejected:
        names = ", ".join(name for name, _ in rejected[:5]) + (", ..." if len(rejected) > 5 else "")
        warnings.warn(
            f"skipped {len(rejected)} of {len(photos)} photos ({names}); first problem: {rejected[0][1]}",
            UserWarning,
            stacklevel=2,
        )
    return Screening(good, tuple(rejected))


def screen_categories(
    listed: Mapping[str, CategoryPhotos], *, size: int, valid_margin: float, index: Path | None, workers: int
) -> dict[str, CategoryPhotos]:
    """The same species without their bad photos; arguments as in :func:`screen_photos`.

    Raises:
        FaunaError: when no photo is left.
    """
    everything = [photo for each in listed.values() for name in LISTS for photo in getattr(each, name)]
    screened = screen_photos(
        everything, size=size, valid_margin=valid_margin, on_bad="skip", index=index, workers=workers
    )
    if not screened.rejected:
        return dict(listed)
    good = set(screened.photos)
    return {
        species: replace(
            each, **{name: tuple(photo for photo in getattr(each, name) if photo in good) for name in LISTS}
        )
        for species, each in listed.items()
    }


def _verdicts(photos: Sequence[Photo], size: int, margin: float, index: Path | None, workers: int) -> list[str]:
    """:data:`USABLE` or the reason against it, for each photo."""
    keys = [_key(photo, size, margin) for photo in photos]
    known = _read_index(index)
    todo = {key: photo for key, photo in zip(keys, photos, strict=True) if key not in known}

    def check(photo: Photo) -> str:
        try:
            load_photo(photo, size=size, valid_margin=margin)
        except FaunaError as error:
            return str(error)
        return USABLE

    stored, last = len(known), time.monotonic()
    checked = in_background(check, todo.values(), workers=workers, ahead=8 * workers)
    shown = track(checked, f"reading {len(todo)} photos (once)", len(todo), disable=len(todo) < SHOW_FROM)
    try:
        for key, verdict in zip(todo, shown, strict=True):
            known[key] = verdict
            if time.monotonic() - last > STORE_SECONDS:
                _write_index(index, known)
                stored, last = len(known), time.monotonic()
    finally:
        if len(known) > stored:
            _write_index(index, known)
    return [known[key] for key in keys]


def _key(photo: Photo, size: int, margin: float) -> str:
    text = f"{CHECKS}|{size}|{margin!r}|{photo.name}|{photo.source.stamp()}"
    return hashlib.blake2b(text.encode(), digest_size=12).hexdigest()


def _read_index(path: Path | None) -> dict[str, str]:
    """Keys of usable photos; an index that cannot be read is an empty one.

    Refusals are not remembered: their cause may be mended without a trace in the photo's own files.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines() if path is not None else []
    except (OSError, UnicodeDecodeError):
        return {}
    return {key: USABLE for key, _, verdict in (line.partition(" ") for line in lines) if verdict == USABLE}


def _write_index(path: Path | None, verdicts: dict[str, str]) -> None:
    """One line per usable photo: key, blank, :data:`USABLE`."""
    if path is not None:
        lines = (f"{key} {verdict}\n" for key, verdict in verdicts.items() if verdict == USABLE)
        write_atomically(path, "".join(lines).encode())
