"""``tallies.npz`` of a report: the sums behind every metric, image by image and pair by pair, from which reports are compared."""

import io
import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from fauna.data.feature_cache import write_atomically
from fauna.errors import FaunaError
from fauna.evaluation.store import UNREADABLE
from fauna.metrics.tally import Tally

FILE = "tallies.npz"


@dataclass(frozen=True)
class NamedTally:
    """A tally and the photographs its owners point to.

    Attributes:
        names: of the species' photographs.
        tally: of one metric.
    """

    names: tuple[str, ...]
    tally: Tally


Tallies = dict[str, dict[str, dict[str, NamedTally]]]
"""By group, key of the metric, species."""


def name_owners(
    tallies: Mapping[str, Mapping[str, Tally]], images: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, NamedTally]]:
    """Join tallies by key and species with the photographs of each species.

    Args:
        tallies: of :func:`fauna.metrics.score.score_with_tallies`.
        images: by photograph, in the order of the scores, with its ``species``.
    """
    names: dict[str, list[str]] = defaultdict(list)
    for name, row in images.items():
        names[row["species"]].append(name)
    return {
        key: {species: NamedTally(tuple(names[species]), tally) for species, tally in rows.items()}
        for key, rows in tallies.items()
    }


def write_tallies(path: Path, tallies: Mapping[str, Mapping[str, Mapping[str, NamedTally]]]) -> None:
    """Write the tallies of a report; counts of zeros and ones take a byte each before compression."""
    rows, arrays = [], {}
    for group, keys in tallies.items():
        for key, by_species in keys.items():
            for species, named in by_species.items():
                number = len(rows)
                tally = named.tally
                rows.append({"of": [group, key, species], "names": named.names, "columns": tally.columns})
                arrays[f"owners{number}"] = tally.owners.astype(np.int32)
                arrays[f"sums{number}"] = _narrow(tally.sums)
                arrays[f"counts{number}"] = _narrow(tally.counts)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, index=np.frombuffer(json.dumps(rows).encode(), np.uint8), **arrays)  # type: ignore[arg-type]
    write_atomically(path, buffer.getvalue())


def read_tallies(path: Path) -> Tallies:
    """What :func:`write_tallies` wrote.

    Raises:
        FaunaError: when the file is missing or damaged.
    """
    found: Tallies = {}
    try:
        with np.load(io.BytesIO(path.read_bytes())) as content:
            for number, row in enumerate(json.loads(content["index"].tobytes())):
                group, key, species = row["of"]
                tally = Tally(
                    content[f"owners{number}"].astype(np.int64),
                    content[f"sums{number}"].astype(np.float64),
                    content[f"counts{number}"].astype(np.float64),
                    tuple(row["columns"]),
                )
                named = NamedTally(tuple(row["names"]), tally)
                found.setdefault(group, {}).setdefault(key, {})[species] = named
    except UNREADABLE as error:
        raise FaunaError(
            f"{path} expects the sums behind a report, got {type(error).__name__}; score it again with "
            "fauna-eval predictions=FOLDER/predictions out=FOLDER"
        ) from error
    return found


def shared(first: NamedTally, other: NamedTally) -> tuple[tuple[str, ...], Tally, Tally]:
    """What two tallies of one metric and species both count, on the same photographs.

    Returns:
        Names of the photographs both know, and both tallies reduced to the units (images or pairs) and columns that count in both;
        their owners point to those names.
    """
    names = tuple(sorted(set(first.names) & set(other.names)))
    columns = tuple(column for column in first.tally.columns if column in other.tally.columns)
    rows = [_codes(each, names) for each in (first, other)]
    _, ours, theirs = np.intersect1d(rows[0], rows[1], return_indices=True)
    known = rows[0][ours] >= 0
    reduced = [
        _reduced(each, names, columns, units[known])
        for each, units in ((first, ours), (other, theirs))
    ]  # fmt: skip
    both = (reduced[0].counts > 0) & (reduced[1].counts > 0)
    ours_only, theirs_only = (replace(each, sums=each.sums * both, counts=each.counts * both) for each in reduced)
    return names, ours_only, theirs_only


def _codes(named: NamedTally, names: Sequence[str]) -> Int[np.ndarray, " unit"]:
    """One number per unit that is the same in both tallies; -1 where a photograph is not shared."""
    owners = _places(named, names)[named.tally.owners]
    weights = len(names) ** np.arange(owners.shape[1])
    return np.where((owners >= 0).all(axis=1), owners @ weights, -1)


def _places(named: NamedTally, names: Sequence[str]) -> Int[np.ndarray, " image"]:
    place = {name: index for index, name in enumerate(names)}
    return np.array([place.get(name, -1) for name in named.names], dtype=np.int64)


def _reduced(named: NamedTally, names: Sequence[str], columns: Sequence[str], units: np.ndarray) -> Tally:
    tally = named.tally
    chosen = [tally.columns.index(column) for column in columns]
    owners = _places(named, names)[tally.owners[units]]
    return Tally(owners, tally.sums[units][:, chosen], tally.counts[units][:, chosen], tuple(columns))


def _narrow(array: np.ndarray) -> np.ndarray:
    small = array.astype(np.uint8)
    return small if np.array_equal(small, array) else array
