"""Sources without annotation files: folders per species, photographs and masks in parallel trees, frames of videos."""

import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fauna.prepare.masks_given import ANY, OBJECTS
from fauna.prepare.record import Record, Rows
from fauna.prepare.sources.base import Source
from fauna.prepare.sources.naming import Naming
from fauna.prepare.sources.walking import is_photo, subfolders, walk
from fauna.reconstruct.mask_files import masks_beside

TRANSPARENT = frozenset({"train", "val", "valid", "validation", "test", "images", "imgs", "photos", "data"})
"""Folder names that say nothing about the species."""


@dataclass(frozen=True)
class FolderSource(Source):
    """``SOURCE/<species>/.../photo.jpg``; masks lie beside (``photo_mask.png``) or in a folder ``masks``.

    Attributes:
        root: folder of the species' folders.
        naming: of the rows.
        kind: ``folders``, ``awa2`` or ``dove``.
        sequences: whether a folder of photographs holds frames of one video.
    """

    root: Path
    naming: Naming
    kind: str = "folders"
    sequences: bool = False
    keypoint_names: tuple[str, ...] | None = None

    def photos(self) -> Iterator[Rows]:
        """Every photograph, folder by folder."""
        for path in walk(self.root, avoid=self.naming.results):
            if isinstance(path, OSError):
                yield (self.naming.unlisted(path, self.root),)
            elif is_photo(path):
                yield self._rows(path)

    def _rows(self, path: Path) -> Rows:
        species = self._species(path)
        licence = licence_beside(path) if self.kind == "awa2" else None
        more: dict[str, Any] = _frame(path, self.naming) if self.sequences else {}
        masks = masks_beside(path)
        if not masks:
            return (self.naming.row(path, species, licence=licence, **more),)
        return tuple(
            self.naming.row(
                path, species, instance=number, licence=licence, given_mask=f"{ANY}:{self.naming.text(mask)}", **more
            )
            for number, mask in enumerate(masks)
        )

    def _species(self, path: Path) -> str | None:
        """The first folder below the root that is not a mere container; for sequences not the video's own folder."""
        parts = path.parent.relative_to(self.root).parts
        named = [part for part in parts if part.lower() not in TRANSPARENT]
        if self.sequences:
            named = named[:-1]
        return named[0] if named else None


@dataclass(frozen=True)
class PairedSource(Source):
    """Photographs in one tree, their masks under the same names in another: Weizmann's horses, DAVIS, ``images`` and ``masks``.

    Attributes:
        kind: ``weizmann``, ``davis`` or ``pairs``.
        images: folder of the photographs.
        masks: folder of the masks.
        naming: of the rows.
        sequences: whether the folders below ``images`` are videos; else they are species.
    """

    kind: str
    images: Path
    masks: Path
    naming: Naming
    sequences: bool
    keypoint_names: tuple[str, ...] | None = None

    def photos(self) -> Iterator[Rows]:
        """Every photograph; one without a mask is left to the segmenter."""
        for path in walk(self.images, avoid=self.naming.results):
            if isinstance(path, OSError):
                yield (self.naming.unlisted(path, self.images),)
            elif is_photo(path):
                yield (self._row(path),)

    def _row(self, path: Path) -> Record:
        relative = path.relative_to(self.images)
        mask = next(filter(os.path.isfile, _mask_names(self.masks / relative)), None)
        species = next((part for part in relative.parts[:-1] if part.lower() not in TRANSPARENT), None)
        holds = OBJECTS if self.kind == "davis" else ANY
        given = None if mask is None else f"{holds}:{self.naming.text(mask)}"
        more: dict[str, Any] = _frame(path, self.naming) if self.sequences and len(relative.parts) > 1 else {}
        return self.naming.row(path, species, given_mask=given, **more)


def find_pairs(root: Path) -> tuple[str, Path, Path] | None:
    """Kind, folder of photographs and folder of masks, if ``root`` has such a pair."""
    named = {path.name.lower(): path for path in subfolders(root)}
    for kind, images, masks in (
        ("weizmann", "rgb", "figure_ground"),
        ("davis", "jpegimages", "annotations"),
        ("pairs", "images", "masks"),
        ("pairs", "rgb", "masks"),
    ):
        if images in named and masks in named and _first(named[masks], is_photo) is not None:
            return kind, named[images], named[masks]
    return None


def is_sequences(root: Path) -> bool:
    """Whether ``root`` has folders of frames in the layout of DOVE's videos: ``<video>/<number>_rgb.png`` and ``_mask.png``."""
    rgb = re.compile(r"\d+_rgb\.(png|jpe?g)", re.IGNORECASE)
    first = _first(root, lambda path: rgb.fullmatch(path.name) is not None)
    return first is not None and first.parent != root and bool(masks_beside(first)) and not _is_crop_set(first)


def is_awa2(root: Path) -> bool:
    """``JPEGImages/<class>/<class>_<number>.jpg``."""
    folders = subfolders(root / "JPEGImages")
    first = _first(folders[0], is_photo) if folders else None
    return first is not None and re.fullmatch(re.escape(folders[0].name) + r"_\d+", first.stem) is not None


def licence_beside(photo: Path) -> str | None:
    """First line of ``<stem>.txt`` in a parallel folder whose name speaks of licences, as AwA2 has them."""
    top = photo.parents[2] if len(photo.parents) > 2 else photo.parent
    for folder in subfolders(top):
        if "licen" in folder.name.lower():
            text = folder / photo.parent.name / f"{photo.stem}.txt"
            if os.path.isfile(text):
                lines = text.read_text(encoding="utf-8", errors="replace").split("\n")
                return next((line.strip() for line in lines if line.strip()), None)
    return None


def _is_crop_set(first: Path) -> bool:
    """The layout of ``data=fauna``: the frames' folder is a split of a species."""
    return first.parent.name.lower() in ("train", "val", "test")


def _first(folder: Path, wanted: Callable[[Path], bool]) -> Path | None:
    found = (path for path in walk(folder, skip=frozenset()) if isinstance(path, Path) and wanted(path))
    return next(found, None)


def _mask_names(path: Path) -> Iterator[Path]:
    for suffix in (".png", path.suffix, ".jpg", ".bmp", ".gif", ".tif"):
        yield path.with_suffix(suffix)
    yield path.with_name(f"{path.stem}_mask.png")


def _frame(path: Path, naming: Naming) -> dict[str, Any]:
    """Group and frame number of a file in a video's folder."""
    number = re.search(r"(\d{1,15})\D*$", path.stem)
    return {"group": naming.text(path.parent), "frame": int(number[1]) if number else None}
