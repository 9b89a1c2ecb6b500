"""A CSV file with a row for each animal: ``image,species`` and, if known, ``mask,licence,provenance,group,left,top,right,bottom``."""

import csv
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from fauna.errors import FaunaError
from fauna.prepare.masks_given import ONE
from fauna.prepare.record import Record, Rows
from fauna.prepare.sources.base import Source
from fauna.prepare.sources.naming import Naming

COLUMNS = ("image", "species", "mask", "licence", "provenance", "group", "left", "top", "right", "bottom")
ALIASES = {
    "file": "image", "filename": "image", "path": "image", "category": "species", "class": "species", "label": "species",
    "license": "licence", "source": "provenance", "url": "provenance", "video": "group",
}  # fmt: skip


@dataclass(frozen=True)
class TableSource(Source):
    """Photographs that a CSV file names, relative to its folder.

    Memory holds a number for each photograph. Several animals of one photograph are lines that follow one another.

    Attributes:
        file: with a header line.
        images: folder that paths start from.
        naming: of the rows.
    """

    file: Path
    images: Path
    naming: Naming
    kind: str = "csv"
    keypoint_names: tuple[str, ...] | None = None

    def photos(self) -> Iterator[Rows]:
        """Photographs in the order of the file.

        Raises:
            FaunaError: when the file has no header with ``image``, or comes back to a photograph.
        """
        seen: set[int] = set()
        for image, lines in groupby(self._lines(), key=lambda line: line[1]["image"]):
            mark = hash(image)
            numbered = list(lines)
            if mark in seen:
                raise FaunaError(
                    f"{self.file} line {numbered[0][0]}: expected all animals of {image} in one place, got it again; sort the file"
                )
            seen.add(mark)
            path = self.images / image
            if not image or not path.is_file() or not _below(path, self.naming.workspace.root):
                name = f"{self.file.name} line {numbered[0][0]}"
                word = "missing" if image else "annotation"
                yield (self.naming.unusable(name, f"{image or 'no photograph'} is missing", word),)
                continue
            yield tuple(self._row(path, index, number, values) for index, (number, values) in enumerate(numbered))

    def _row(self, path: Path, index: int, number: int, values: Mapping[str, str]) -> Record:
        mask = values.get("mask")
        box = self._box(number, values)
        if mask and not _below(self.images / mask, self.naming.workspace.root):
            name = f"{self.file.name} line {number}"
            return self.naming.unusable(name, f"mask {mask} is outside of the source", "annotation")
        return self.naming.row(
            path,
            values.get("species"),
            instance=index,
            group=values.get("group"),
            licence=values.get("licence"),
            provenance=values.get("provenance"),
            origin=f"{self.file.name} line {number}",
            box=box,
            given_mask=None if not mask else f"{ONE}:{self.naming.text(self.images / mask)}",
        )

    def _box(self, number: int, values: Mapping[str, str]) -> tuple[float, float, float, float] | None:
        texts = [values.get(key) for key in COLUMNS[-4:]]
        if not any(texts):
            return None
        try:
            left, top, right, bottom = (float(text or "") for text in texts)
            if not (math.isfinite(left + top + right + bottom) and left < right and top < bottom):
                raise ValueError("no box")
        except ValueError as error:
            raise FaunaError(
                f"{self.file} line {number}: expected left,top,right,bottom as numbers with left < right and top < bottom, got {texts}; mend the file"
            ) from error
        return left, top, right, bottom

    def _lines(self) -> Iterator[tuple[int, dict[str, str]]]:
        """Line number and values by column, empty ones left out; ``image`` is always there."""
        try:
            with self.file.open(encoding="utf-8-sig", newline="") as handle:
                reader = csv.DictReader(handle)
                names = {name: column(name) for name in reader.fieldnames or () if name}
                if "image" not in names.values():
                    raise FaunaError(
                        f"{self.file} expects a header with image (and species, mask, licence, ...), got "
                        f"{list(reader.fieldnames or ())}; add one"
                    )
                for values in reader:
                    line = {names[key]: text.strip() for key, text in values.items() if key in names and text}
                    yield reader.line_num, {"image": "", **{key: text for key, text in line.items() if text}}
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise FaunaError(f"{self.file} expects a CSV file in UTF-8, got {error}; save it so") from error


def column(name: str) -> str:
    """What a column holds, by its name in the header.

    >>> column(' "Filename"')
    'image'
    """
    plain = name.strip().strip('"').lower()
    return ALIASES.get(plain, plain)


def _below(path: Path, folder: Path) -> bool:
    """Whether a path that a file names stays within the source."""
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError):  # a name with a null byte, a link to itself
        return False
