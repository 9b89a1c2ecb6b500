"""``fauna-eval compare A B C``: reports side by side, with paired significance on the photographs they share."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fauna.errors import FaunaError
from fauna.evaluation.report_md import metrics_of, ordered, spell
from fauna.evaluation.tallies import FILE as TALLIES
from fauna.evaluation.tallies import Tallies, read_tallies, shared
from fauna.io.run_folder import write_json
from fauna.metrics.keys import better
from fauna.metrics.tally import estimates, mean_ignoring_nan, resampling

USAGE = "fauna-eval compare REPORT REPORT [REPORT ...] [out=FILE.json] [bootstrap=1000] [seed=0]"
PERCENTILES = (2.5, 97.5)
PROTOCOL = ("seed", "pairs", "size", "settings")
"""Choices that reports should share."""
NOTHING = {"difference": None, "low": None, "high": None, "p": None, "n": 0}


@dataclass(frozen=True)
class Loaded:
    """A report folder.

    Attributes:
        name: shown in tables.
        report: content of ``report.json``.
        tallies: of ``tallies.npz``.
    """

    name: str
    report: Mapping[str, Any]
    tallies: Tallies


def compare_command(arguments: Sequence[str]) -> None:
    """Print the comparison of the given report folders, and write it to ``out=`` if given.

    Raises:
        FaunaError: for wrong arguments or folders that cannot be compared.
    """
    if not arguments or arguments[0] in ("-h", "--help"):
        print(f"usage: {USAGE}\nEvery report is compared with the first, photograph by photograph.")
        return
    folders, options = split_arguments(arguments, {"out": "", "bootstrap": "1000", "seed": "0"}, USAGE)
    if len(folders) < 2:
        raise FaunaError(f"compare: expected at least two report folders, got {len(folders)}; usage: {USAGE}")
    bootstrap, seed = whole("bootstrap", options["bootstrap"]), whole("seed", options["seed"])
    paths = [Path(folder).expanduser() for folder in folders]
    loaded = [load(path, name) for path, name in zip(paths, distinct_names(paths), strict=True)]
    result = compare(loaded, bootstrap=bootstrap, seed=seed)
    if options["out"]:
        write_json(result, Path(options["out"]).expanduser())
    print(text(result))


def compare(loaded: Sequence[Loaded], *, bootstrap: int, seed: int) -> dict[str, Any]:
    """Each report against the first.

    What a photograph (or a pair of them) adds to a metric in one report is paired with what it adds in the other; see :func:`paired`.

    Args:
        loaded: two or more reports.
        bootstrap: replicates.
        seed: of the draws.

    Returns:
        ``reports``: names; ``warnings``: protocols that differ; ``metrics``: by group and key, of all reports together, ``values`` (as
        reported, one of each; ``None`` where a report lacks the key), ``better`` (``higher``, ``lower`` or empty) and
        ``against_first`` (``difference``, ``low``, ``high``, ``p``, ``n`` of each other report).
    """
    groups: dict[str, Any] = {}
    for group in dict.fromkeys(group for each in loaded for group in each.tallies):
        reported = [metrics_of(each.report, group) for each in loaded]
        groups[group] = {
            key: {
                "values": [metrics.get(key, {}).get("value") for metrics in reported],
                "better": better(key),
                "against_first": [
                    paired(loaded[0], other, group, key, bootstrap=bootstrap, seed=seed) for other in loaded[1:]
                ],
            }
            for key in counted_by_any(reported)
        }
    return {"reports": [each.name for each in loaded], "warnings": _warnings(loaded), "metrics": groups}


def paired(first: Loaded, other: Loaded, group: str, key: str, *, bootstrap: int, seed: int) -> dict[str, Any]:
    """Difference (other - first) of one metric over what both reports count.

    Both are computed by the rule of the report (per species the mean over keypoints, then the mean over species) from the photographs,
    or pairs of them, that count in both. The interval draws photographs within each species, the same for both reports; a pair
    counts as often as the product of its two photographs' draws (:func:`fauna.metrics.tally.estimates`). ``p`` is two-sided: twice
    the smaller share of replicates on either side of zero, at least 1 / replicates.
    """
    ours, theirs = (each.tallies.get(group, {}).get(key, {}) for each in (first, other))
    values, spreads, numbers = [], [], []
    for species in [name for name in ours if name in theirs]:
        names, a, b = shared(ours[species], theirs[species])
        if not a.counts.any():
            continue
        ones, drawn = np.ones((1, len(names))), resampling(names, replicates=bootstrap, seed=seed)
        values.append(float((estimates(b, ones) - estimates(a, ones))[0]))
        spreads.append(estimates(b, drawn) - estimates(a, drawn))
        numbers.append(len(np.unique(a.owners[a.counts.any(axis=1)])))
    if not values:
        return dict(NOTHING)
    row = {**NOTHING, "difference": float(np.mean(values)), "n": sum(numbers)}
    return row if max(numbers) < 2 else {**row, **_interval(mean_ignoring_nan(spreads))}


def load(folder: Path, name: str | None = None) -> Loaded:
    """Read a report folder.

    Args:
        folder: ``out`` of an evaluation.
        name: shown in tables, by default that of the folder.

    Raises:
        FaunaError: when it holds no report.
    """
    try:
        report = json.loads((folder / "report.json").read_text("utf-8"))
        for key in PROTOCOL:
            report["protocol"][key]
        str(report["protocol"]["dataset"]["sha256"])
        for metrics in (report["metrics"], report.get("held_out", {"metrics": {}})["metrics"]):
            [(row["value"], row["n"]) for row in metrics.values()]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FaunaError(
            f"compare: expected a folder with the report.json of fauna-eval, got {folder} ({type(error).__name__}); "
            "name the out folder of an evaluation that has ended"
        ) from error
    return Loaded(name or distinct_names([folder])[0], report, read_tallies(folder / TALLIES))


def distinct_names(folders: Sequence[Path]) -> list[str]:
    """Short names of report folders, with as many parts of their paths as tell them apart; a last part ``evaluation`` is left out.

    >>> distinct_names([Path("runs/a/evaluation"), Path("runs/b")])
    ['a', 'b']
    >>> distinct_names([Path("one/0/evaluation"), Path("two/0/evaluation"), Path("two/0")])
    ['one/0', 'two/0', 'two/0 (2)']
    """
    whole_parts = [folder.absolute().parts for folder in folders]
    parts = [path[:-1] if path[-1] == "evaluation" and len(path) > 2 else path for path in whole_parts]
    names: list[str] = []
    for number, path in enumerate(parts):
        others = {other for other in parts if other != path}
        length = next((n for n in range(1, len(path)) if not any(o[-n:] == path[-n:] for o in others)), len(path))
        repeated = parts[:number].count(path)
        names.append("/".join(path[-length:]) + (f" ({repeated + 1})" if repeated else ""))
    return names


def counted_by_any(reported: Iterable[Mapping[str, Any]]) -> list[str]:
    """Keys that count at least one photograph in any of the tables of metrics, in the order of reports."""
    return ordered({key for metrics in reported for key, row in metrics.items() if row["n"]})


def text(result: Mapping[str, Any]) -> str:
    """The comparison as a table of text."""
    width = max(12, *(len(name) + 2 for name in result["reports"]))
    lines = [f"warning: {warning}" for warning in result["warnings"]]
    for group, rows in result["metrics"].items():
        names = "".join(f"{name:>{width}s}" for name in result["reports"])
        lines += [
            *([""] if lines else []),
            f"{group:32s}{names}   difference to {result['reports'][0]} [95 % interval], p, photographs",
        ]
        for key, row in rows.items():
            values = "".join(f"{spell(value):>{width}s}" for value in row["values"])
            differences = [_spell_difference(each, row["better"]) for each in row["against_first"]]
            lines.append(f"{key:32s}{values}   {' | '.join(differences)}")
    return "\n".join(lines)


def split_arguments(
    arguments: Sequence[str], defaults: Mapping[str, str], usage: str
) -> tuple[list[str], dict[str, str]]:
    """Folders and ``key=value`` options; a word is an option when its key is a known one.

    Raises:
        FaunaError: for an option that starts with a dash.
    """
    folders, options = [], dict(defaults)
    for word in arguments:
        key, equals, value = word.partition("=")
        if equals and key in defaults:
            options[key] = value
        elif word.startswith("-"):
            raise FaunaError(f"{word}: expected a folder or one of {', '.join(defaults)}, got a flag; usage: {usage}")
        else:
            folders.append(word)
    return folders, options


def whole(key: str, value: str) -> int:
    """A whole number >= 0.

    Raises:
        FaunaError: for anything else.
    """
    if not value.isdigit() or (key == "bootstrap" and int(value) < 1):
        raise FaunaError(f"{key}: expected a whole number, got {value!r}; e.g. {key}=1000")
    return int(value)


def _interval(replicates: Float[np.ndarray, " replicate"]) -> dict[str, float]:
    replicates = replicates[np.isfinite(replicates)]
    if not len(replicates):  # few replicates may miss every pair
        return {}
    low, high = np.percentile(replicates, PERCENTILES)
    tail = min(np.mean(replicates <= 0), np.mean(replicates >= 0))
    return {"low": float(low), "high": float(high), "p": float(min(1.0, max(2 * tail, 1 / len(replicates))))}


def _warnings(loaded: Sequence[Loaded]) -> list[str]:
    first = loaded[0].report["protocol"]
    found = []
    for other in loaded[1:]:
        theirs = other.report["protocol"]
        if theirs["dataset"]["sha256"] != first["dataset"]["sha256"]:
            found.append(
                f"{other.name} was evaluated on other photographs than {loaded[0].name}; only shared ones are paired"
            )
        for key in PROTOCOL:
            if theirs[key] != first[key]:
                found.append(f"{other.name} has {key}={theirs[key]}, {loaded[0].name} has {key}={first[key]}")
    return found


def _spell_difference(row: Mapping[str, Any], direction: str) -> str:
    if row["difference"] is None:
        return "–"
    if row["low"] is None:
        return f"{row['difference']:+.3f}, {row['n']}: one photograph of each species shows nothing"
    good = (row["difference"] > 0) == (direction == "higher")
    sign = ("better" if good else "worse") if row["low"] > 0 or row["high"] < 0 else "no difference shown"
    return f"{row['difference']:+.3f} [{row['low']:+.3f}, {row['high']:+.3f}], p {row['p']:.3f}, {row['n']}: {sign}"
