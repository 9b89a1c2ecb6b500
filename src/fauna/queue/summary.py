"""The table of a queue: a row each, means over its seeds, and paired differences to the first row."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fauna.data.feature_cache import write_atomically
from fauna.evaluation.compare import Loaded, load, paired
from fauna.evaluation.report_md import spell
from fauna.io.run_folder import write_json
from fauna.queue.plan import Plan, Run
from fauna.queue.runner import REPORT, report_folder

BOOTSTRAP = 1000
GROUPS = {"metrics": "", "held_out": "held out"}
"""Parts of a report and what columns of them are called."""


def summarise(plan: Plan, out: Path) -> dict[str, Any]:
    """Everything that has been evaluated so far, also written to ``table.json`` and ``table.md`` in ``out``.

    Returns:
        ``evaluations``: by name and row ``seeds`` (those evaluated), ``values`` (by column the mean over seeds, and each seed's),
        ``differences`` (by column to the first row: the mean over the seeds that both have, the mean of their paired 95 % intervals over
        photographs, the seeds' own differences, and ``clear``: the interval excludes zero and all seeds agree in sign).
    """
    result = {"experiment": plan.experiment, "evaluations": {}}
    for name in plan.evaluations:
        loaded = {
            run: load(report_folder(out, run, name), run.name)
            for run in plan.runs()
            if (report_folder(out, run, name) / REPORT).is_file()
        }
        result["evaluations"][name] = {row: _row(plan, row, loaded) for row in plan.rows}
    write_json(result, out / "table.json")
    write_atomically(out / "table.md", markdown(plan, result).encode())
    return result


def markdown(plan: Plan, result: Mapping[str, Any]) -> str:
    """One table for each evaluation; a star marks what differs clearly from the first row."""
    parts = []
    for name, rows in result["evaluations"].items():
        columns = list(dict.fromkeys(column for row in rows.values() for column in row["values"]))
        lines = [["", "seeds", *columns], ["---"] * (2 + len(columns))]
        for row, found in rows.items():
            cells = [row, ", ".join(map(str, found["seeds"])) or "none yet"]
            for column in columns:
                value, difference = found["values"].get(column), found["differences"].get(column)
                spread = (
                    f" ({spell(min(value['seeds']))} to {spell(max(value['seeds']))})"
                    if value and len(value["seeds"]) > 1
                    else ""
                )
                cells.append(
                    (spell(value["mean"]) + ("*" if difference and difference["clear"] else "") + spread)
                    if value
                    else ""
                )
            lines.append(cells)
        parts.append(f"**{name}**\n\n" + "\n".join("| " + " | ".join(cells) + " |" for cells in lines))
    first = next(iter(plan.rows))
    note = (
        f"Means over seeds (lowest to highest). A star: the 95 % interval over photographs of the paired difference to {first}, "
        "averaged over the seeds, excludes zero, and all seeds agree in sign."
    )
    return "\n\n".join([*parts, note]) + "\n"


def _row(plan: Plan, row: str, loaded: Mapping[Run, Loaded]) -> dict[str, Any]:
    first = {run.seed: report for run, report in loaded.items() if run.row == next(iter(plan.rows))}
    own = {run.seed: report for run, report in loaded.items() if run.row == row}
    values, differences = {}, {}
    for group, title in GROUPS.items():
        for metric in plan.metrics:
            column = f"{title} {metric}".strip()
            _fill(values, column, [_value(report, group, metric) for report in own.values()])
            shared = sorted(set(own) & set(first)) if own != first else []
            rows = [paired(first[seed], own[seed], group, metric, bootstrap=BOOTSTRAP, seed=0) for seed in shared]
            if rows and all(each["low"] is not None for each in rows):
                differences[column] = _difference(rows)
    for title, species in plan.groups.items():
        for metric in plan.metrics:
            found = [_mean_of_species(report, species, metric) for report in own.values()]
            _fill(values, f"{title} {metric}", found)
    return {"seeds": sorted(own), "values": values, "differences": differences}


def _fill(values: dict[str, Any], column: str, found: Sequence[float | None]) -> None:
    known = [value for value in found if value is not None]
    if known and len(known) == len(found):
        values[column] = {"mean": sum(known) / len(known), "seeds": known}


def _difference(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    mean = {key: sum(each[key] for each in rows) / len(rows) for key in ("difference", "low", "high")}
    agree = len({each["difference"] > 0 for each in rows}) == 1
    return {
        **mean,
        "seeds": [each["difference"] for each in rows],
        "clear": agree and (mean["low"] > 0 or mean["high"] < 0),
    }


def _value(report: Loaded, group: str, metric: str) -> float | None:
    part = report.report.get(group, {})
    return (part if group == "metrics" else part.get("metrics", {})).get(metric, {}).get("value")


def _mean_of_species(report: Loaded, species: Sequence[str], metric: str) -> float | None:
    all_species = report.report["species"]
    found = [all_species.get(name, {}).get("metrics", {}).get(metric, {}).get("value") for name in species]
    known = [value for value in found if value is not None]
    return sum(known) / len(known) if known else None
