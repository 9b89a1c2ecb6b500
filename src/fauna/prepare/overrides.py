"""Lists that people keep: what to use or leave out whatever the filter says, and which photographs are back views."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from fauna.errors import FaunaError
from fauna.prepare.record import Record

VERDICTS = ("keep", "drop")


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


def read_overrides(path: Path | None) -> Overrides:
    """The list of a file: two columns, ``id or source`` and ``keep`` or ``drop``; a line that starts with # is a remark.

    Raises:
        FaunaError: naming the first line of another form.
    """
    if path is None:
        return Overrides({})
    verdicts: dict[str, str] = {}
    for number, line in _lines(path, "overrides"):
        fields = next(csv.reader([line]))
        if len(fields) < 2 or fields[1].strip() not in VERDICTS:
            raise FaunaError(f"{path} line {number}: expected `id,keep` or `id,drop`, got {line[:60]!r}; mend it")
        verdicts[fields[0].strip()] = fields[1].strip()
    return Overrides(verdicts)


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
