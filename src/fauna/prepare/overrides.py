"""Lists that people keep: what to use or leave out whatever the filter says, and which photographs are back views."""

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from fauna.errors import FaunaError
from fauna.prepare.record import Record
from fauna.prepare.tables import read_columns

VERDICTS = ("keep", "drop")
ROW_ID = re.compile(r"([0-9a-f]{16})_\d{2,}")


@dataclass(frozen=True)
class Overrides:
    """Verdicts by id of a row, id of a photo, or source.

    Attributes:
        verdicts: ``keep`` or ``drop`` by any of the three.
    """

    verdicts: Mapping[str, str]

    def of(self, row: Record) -> str | None:
        """The verdict on a row: that on its id, else on its photo, else on its source."""
        names = (row.id, row.photo, row.source)
        return next((self.verdicts[name] for name in names if name in self.verdicts), None)

    def about(self, row: Record) -> str:
        """All that is said about the animals of a row's photograph: what is decided again when it changes. Empty for nothing."""
        animals = self._animals.get(row.photo, ())
        named = {name: self.verdicts[name] for name in (row.photo, row.source, *animals) if name in self.verdicts}
        return "".join(f"|{name}={verdict}" for name, verdict in sorted(named.items()))

    @cached_property
    def _animals(self) -> dict[str, list[str]]:
        """Ids of rows by the photo in them."""
        found: dict[str, list[str]] = {}
        for name in self.verdicts:
            match = ROW_ID.fullmatch(name)
            if match is not None:
                found.setdefault(match[1], []).append(name)
        return found


def read_overrides(path: Path | None) -> Overrides:
    """The list of a file: two columns, ``id or source`` and ``keep`` or ``drop``; a line that starts with # is a remark.

    Raises:
        FaunaError: naming the first line of another form, or that says the opposite of an earlier one.
    """
    if path is None:
        return Overrides({})
    verdicts: dict[str, str] = {}
    for number, line in _lines(path, "overrides"):
        fields = [field.strip() for field in next(csv.reader([line]))]
        if len(fields) < 2 or fields[1] not in VERDICTS:
            raise FaunaError(f"{path} line {number}: expected `id,keep` or `id,drop`, got {line[:60]!r}; mend it")
        if verdicts.setdefault(fields[0], fields[1]) != fields[1]:
            raise FaunaError(f"{path} line {number}: expected keep or drop for {fields[0]}, got both; remove a line")
    return Overrides(verdicts)


def expect_known(lists: Mapping[str, Iterable[str]], tables: Sequence[Path]) -> None:
    """Refuse lists that name what is not there: a slip of the pen would pass unnoticed otherwise.

    Args:
        lists: names by the key of the setting that gave their file.
        tables: of all shards, of ``mask`` or a later step: further animals of a photograph have their rows then.

    Raises:
        FaunaError: with the first unknown names of a list and their number.
    """
    unknown = {key: set(names) for key, names in lists.items()}
    for table in tables:
        if not any(unknown.values()):
            return
        for part in read_columns(table, ["id", "photo", "source"]):
            for names in unknown.values():
                for column in part.values():
                    names.difference_update(column)
    for key, names in unknown.items():
        if names:
            first = ", ".join(sorted(names)[:3]) + (", ..." if len(names) > 3 else "")
            raise FaunaError(
                f"{key}: expected ids, photographs or sources of the set, got {len(names)} that it does not have ({first}); "
                "remove them from the list, or mend them"
            )


def read_names(path: Path | None, key: str) -> frozenset[str]:
    """Ids or sources, one a line.

    Raises:
        FaunaError: when the file cannot be read.
    """
    return frozenset() if path is None else frozenset(line for _, line in _lines(path, key))


def _lines(path: Path, key: str) -> list[tuple[int, str]]:
    try:
        text = path.expanduser().read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise FaunaError(f"{key}: expected a text file, got {path} ({error}); check the path") from error
    stripped = ((number, line.strip()) for number, line in enumerate(text.splitlines(), start=1))
    return [(number, line) for number, line in stripped if line and not line.startswith("#")]
