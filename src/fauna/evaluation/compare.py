"""``fauna-eval compare A B C``: reports side by side, with paired significance on the photographs they share."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from fauna.errors import FaunaError
from fauna.evaluation.report_md import counted, spell
from fauna.io.run_folder import write_json
from fauna.metrics.keys import lower_is_better
from fauna.random import derive_seed

USAGE = "fauna-eval compare REPORT REPORT [REPORT ...] [out=FILE.json] [bootstrap=1000] [seed=0]"
PERCENTILES = (2.5, 97.5)


@dataclass(frozen=True)
class Loaded:
    """A report folder.

    Attributes:
        name: shown in tables.
        report: content of ``report.json``.
        images: of ``images.json``: group -> photograph -> ``{"species", "scores"}``.
    """

    name: str
    report: Mapping[str, Any]
    images: Mapping[str, Mapping[str, Any]]


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
    loaded = [load(Path(folder)) for folder in folders]
    result = compare(loaded, bootstrap=whole("bootstrap", options["bootstrap"]), seed=whole("seed", options["seed"]))
    print(text(result))
    if options["out"]:
        write_json(result, Path(options["out"]))


def compare(loaded: Sequence[Loaded], *, bootstrap: int, seed: int) -> dict[str, Any]:
    """Each report against the first.

    The score of a photograph in one report is paired with its score in the other. Differences are averaged within species and then
    over species. The interval comes from drawing photographs within each species; ``p`` is two-sided: twice the smaller share of
    replicates on either side of zero, at least 1 / replicates.

    Args:
        loaded: two or more reports.
        bootstrap: replicates.
        seed: of the draws.

    Returns:
        ``reports``: names; ``warnings``: protocols that differ; ``metrics``: by group and key ``values`` (as reported, one of each)
        and ``against_first`` (``difference``, ``low``, ``high``, ``p``, ``n`` of each other report).
    """
    first = loaded[0]
    groups: dict[str, Any] = {}
    for group in first.images:
        reported = [_metrics(each, group) for each in loaded]
        rows = {}
        for key in counted(reported[0]):
            others = [paired(first, other, group, key, bootstrap=bootstrap, seed=seed) for other in loaded[1:]]
            values = [metrics.get(key, {}).get("value") for metrics in reported]
            rows[key] = {
                "values": values,
                "better": "lower" if lower_is_better(key) else "higher",
                "against_first": others,
            }
        groups[group] = rows
    return {"reports": [each.name for each in loaded], "warnings": _warnings(loaded), "metrics": groups}


def paired(first: Loaded, other: Loaded, group: str, key: str, *, bootstrap: int, seed: int) -> dict[str, Any]:
    """Difference (other - first) of one metric over the photographs both have scored; see :func:`compare`."""
    differences: dict[str, list[float]] = {}
    for name, row in sorted(first.images.get(group, {}).items()):
        ours = row["scores"].get(key)
        theirs = other.images.get(group, {}).get(name, {"scores": {}})["scores"].get(key)
        if ours is not None and theirs is not None:
            differences.setdefault(row["species"], []).append(theirs - ours)
    if not differences:
        return {"difference": None, "low": None, "high": None, "p": None, "n": 0}
    number = sum(map(len, differences.values()))
    difference = float(np.mean([np.mean(rows) for rows in differences.values()]))
    if max(map(len, differences.values())) < 2:  # nothing to draw from
        return {"difference": difference, "low": None, "high": None, "p": None, "n": number}
    replicates = np.mean([_replicates(rows, species, bootstrap, seed) for species, rows in differences.items()], axis=0)
    low, high = np.percentile(replicates, PERCENTILES)
    tail = min(np.mean(replicates <= 0), np.mean(replicates >= 0))
    return {
        "difference": difference,
        "low": float(low),
        "high": float(high),
        "p": float(min(1.0, max(2 * tail, 1 / bootstrap))),
        "n": number,
    }


def load(folder: Path) -> Loaded:
    """Read a report folder.

    Raises:
        FaunaError: when it holds no report.
    """
    try:
        report, images = (json.loads((folder / name).read_text("utf-8")) for name in ("report.json", "images.json"))
        if not {"metrics", "protocol"} <= set(report):
            raise ValueError("another kind of report")
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FaunaError(
            f"compare: expected a folder with report.json and images.json, got {folder} ({type(error).__name__}); "
            "name the out folder of an evaluation"
        ) from error
    return Loaded(folder.parent.name if folder.name == "evaluation" else folder.name, report, images)


def text(result: Mapping[str, Any]) -> str:
    """The comparison as a table of text."""
    width = max(12, *(len(name) + 2 for name in result["reports"]))
    lines = [f"warning: {warning}" for warning in result["warnings"]]
    for group, rows in result["metrics"].items():
        names = "".join(f"{name:>{width}s}" for name in result["reports"])
        lines += ["", f"{group:32s}{names}   difference to {result['reports'][0]} [95 % interval], p, photographs"]
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


def _replicates(rows: Sequence[float], species: str, bootstrap: int, seed: int) -> Float[np.ndarray, " replicate"]:
    rng = np.random.default_rng(derive_seed(seed, "compare", species))
    values = np.asarray(rows)
    return rng.multinomial(len(values), np.full(len(values), 1 / len(values)), size=bootstrap) @ values / len(values)


def _metrics(loaded: Loaded, group: str) -> Mapping[str, Any]:
    return loaded.report["metrics"] if group == "metrics" else loaded.report.get(group, {}).get("metrics", {})


def _warnings(loaded: Sequence[Loaded]) -> list[str]:
    first = loaded[0].report["protocol"]
    found = []
    for other in loaded[1:]:
        theirs = other.report["protocol"]
        if theirs["dataset"]["sha256"] != first["dataset"]["sha256"]:
            found.append(
                f"{other.name} was evaluated on other photographs than {loaded[0].name}; only shared ones are paired"
            )
        for key in ("seed", "pairs", "size", "settings"):
            if theirs[key] != first[key]:
                found.append(f"{other.name} has {key}={theirs[key]}, {loaded[0].name} has {key}={first[key]}")
    return found


def _spell_difference(row: Mapping[str, Any], better: str) -> str:
    if row["difference"] is None:
        return "–"
    if row["low"] is None:
        return f"{row['difference']:+.3f}, {row['n']}: one photograph of each species shows nothing"
    good = (row["difference"] > 0) == (better == "higher")
    sign = ("better" if good else "worse") if row["low"] > 0 or row["high"] < 0 else "no difference shown"
    return f"{row['difference']:+.3f} [{row['low']:+.3f}, {row['high']:+.3f}], p {row['p']:.3f}, {row['n']}: {sign}"
