"""A CSV file with a row for each animal: ``image,species`` and, if known, ``mask,licence,provenance,group,left,top,right,bottom``."""

import csv
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from fauna.errors import FaunaError
from fauna.prepare.masks_given import ONE
from fauna.prepare.record import Record, Rows
from fauna.prepare.sources.base import Source
from fauna.prepare.sources.naming import FARTHEST, Naming

COLUMNS = ("image", "species", "mask", "licence", "provenance", "group", "left", "top", "right", "bottom")
BOX = COLUMNS[-4:]
ANIMAL = ("mask", *BOX)
"""What tells the animals of a photograph apart."""
ALIASES = {
    "file": "image", "filename": "image", "path": "image", "category": "species", "class": "species", "label": "species",
    "license": "licence", "source": "provenance", "url": "provenance", "video": "group",
}  # fmt: skip


@dataclass(frozen=True)
class TableSource(Source):
    """Photographs that a CSV file names, relative to its folder.

    Several animals of one photograph are lines that follow one another. Memory holds two numbers for each line.

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
        """Photographs in the order of the file; a line that cannot be used, or says again what an earlier one says, is a row with a reason.

        Raises:
            FaunaError: when the file has no header with ``image``, or comes back to a photograph with another animal.
        """
        said: dict[int, int] = {}
        begun: set[int] = set()
        for place, lines in groupby(self._placed_lines(), key=lambda line: line[0]):
            found: list[tuple[int, dict[str, str]]] = []
            for _, number, values in lines:
                fault = None if place is not None else f"{values['image'] or 'no photograph'} is missing"
                word = "missing" if values["image"] else "annotation"
                if fault is None:
                    fault, word = self._fault(values), "annotation"
                if fault is None:
                    mark = hash((place, *(values.get(key) for key in ANIMAL)))
                    before = said.setdefault(mark, number)
                    fault = None if before == number else f"names the same animal as line {before}"
                if fault is None:
                    found.append((number, values))
                else:
                    yield (self.naming.unusable(f"{self.file.name} line {number}", fault, word),)
            if place is None or not found:
                continue
            if hash(place) in begun:
                raise FaunaError(
                    f"{self.file} line {found[0][0]}: expected all animals of {place} in one place, got it again; sort the file"
                )
            begun.add(hash(place))
            path = self.naming.workspace.photo(place)
            yield tuple(self._row(path, index, number, values) for index, (number, values) in enumerate(found))

    def _placed_lines(self) -> Iterator[tuple[str | None, int, dict[str, str]]]:
        """The photograph of every line by its one text (``./a.jpg`` is ``a.jpg``), ``None`` where there is no such file; number; values."""
        for number, values in self._lines():
            path = self.images / values["image"]
            there = bool(values["image"]) and os.path.isfile(path) and self._text(path) is not None
            yield self._text(path) if there else None, number, values

    def _text(self, path: Path) -> str | None:
        """The text of a file of the source, also of one that links lead to; ``None`` for another."""
        try:
            text = self.naming.text(path)
            folders = self.naming.workspace
            within = folders.work if text.startswith("work:") else folders.root
            return text if path.resolve().is_relative_to(within.resolve()) else None
        except (FaunaError, OSError, ValueError):  # a name with a null byte, a link to itself
            return None

    def _fault(self, values: Mapping[str, str]) -> str | None:
        """What is wrong with a line by itself."""
        mask = values.get("mask")
        if mask and self._text(self.images / mask) is None:
            return f"mask {mask} is outside of the source"
        if any(values.get(key) for key in BOX) and _box(values) is None:
            texts = [values.get(key) for key in BOX]
            return f"expected left,top,right,bottom as numbers with left < right and top < bottom, got {texts}"
        return None

    def _row(self, path: Path, index: int, number: int, values: Mapping[str, str]) -> Record:
        mask = values.get("mask")
        return self.naming.row(
            path,
            values.get("species"),
            instance=index,
            group=values.get("group"),
            licence=values.get("licence"),
            provenance=values.get("provenance"),
            origin=f"{self.file.name} line {number}",
            box=_box(values),
            given_mask=None if not mask else f"{ONE}:{self.naming.text(self.images / mask)}",
        )

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


def _box(values: Mapping[str, str]) -> tuple[float, float, float, float] | None:
    """The box of a line, ``None`` without one or where it is none."""
    try:
        left, top, right, bottom = (float(values.get(key) or "") for key in BOX)
    except ValueError:
        return None
    near = all(abs(side) <= FARTHEST for side in (left, top, right, bottom))  # not so for what is no number
    good = near and left < right and top < bottom
    return (left, top, right, bottom) if good else None
