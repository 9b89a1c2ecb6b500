"""``fauna-eval table MULTIRUN_FOLDER``: ablations and bank sizes from the runs of one sweep, in one table."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from fauna.data.feature_cache import write_atomically
from fauna.errors import FaunaError
from fauna.evaluation.compare import Loaded, counted_by_any, load, paired, split_arguments, whole
from fauna.evaluation.report_md import spell
from fauna.io.checkpoint import checkpoints
from fauna.io.run_folder import write_json

USAGE = "fauna-eval table MULTIRUN_FOLDER [evaluation key=value ...]"
REPORT = "evaluation"
"""Folder of a run that holds its report."""
BOOTSTRAP = 1000

Evaluate = Callable[[Path, Path, list[str]], dict[str, Any]]
"""(run folder, folder for the report, overrides) -> report."""


def table_command(arguments: Sequence[str], evaluate: Evaluate) -> None:
    """Evaluate the runs that have no report yet, and write ``table.json`` and ``table.md`` into the sweep's folder.

    Args:
        arguments: the sweep's folder, then keys of ``fauna-eval`` that hold for all runs.
        evaluate: evaluates one run.

    Raises:
        FaunaError: for wrong arguments, or a folder none of whose runs can be evaluated.
    """
    if not arguments or arguments[0] in ("-h", "--help"):
        print(f"usage: {USAGE}\nRuns without {REPORT}/report.json are evaluated first.")
        return
    folders, options = split_arguments(arguments, {"seed": "0"}, USAGE)
    words = [word for word in folders if "=" not in word]
    overrides = [word for word in folders if "=" in word]
    if len(words) != 1:
        raise FaunaError(f"table: expected one folder, got {len(words)}; usage: {USAGE}")
    sweep, seed = Path(words[0]).expanduser(), whole("seed", options["seed"])
    runs = find_runs(sweep)
    missing = evaluate_missing(runs, [*overrides, f"seed={seed}"], evaluate)
    if len(missing) == len(runs):
        raise FaunaError(
            f"table: expected a run of {sweep} that can be evaluated, got none; of {runs[0].name}: {missing[runs[0]]}"
        )
    result = build_table(runs, seed=seed, missing=missing)
    write_json(result, sweep / "table.json")
    write_atomically(sweep / "table.md", markdown(result).encode())
    print(markdown(result))
    print(f"table: {sweep / 'table.md'}")


def find_runs(sweep: Path) -> list[Path]:
    """Folders of the runs of a sweep, with and without weights, in the order of the jobs.

    Raises:
        FaunaError: when there is none.
    """
    found = [path.parent.parent for path in sweep.glob("*/.hydra/overrides.yaml")]
    if not found:
        raise FaunaError(
            f"table: expected the folder of a sweep (fauna-train -m ...) with a folder for each run, got {sweep} without any; "
            "check the path"
        )
    return sorted(found, key=lambda run: (not run.name.isdigit(), int(run.name) if run.name.isdigit() else 0, run.name))


def evaluate_missing(runs: Sequence[Path], overrides: list[str], evaluate: Evaluate) -> dict[Path, str]:
    """Evaluate the runs without a report.

    Returns:
        Why there is none, for each run that still has no report.
    """
    missing = {}
    for run in runs:
        if (run / REPORT / "report.json").is_file():
            continue
        if not (run / "weights.safetensors").is_file() and not checkpoints(run / "checkpoints"):
            missing[run] = "no weights: refused, failed or not begun; its log says more"
            continue
        print(f"evaluating {run}")
        try:
            evaluate(run, run / REPORT, overrides)
        except FaunaError as error:
            missing[run] = f"not evaluated: {error}"
    return missing


def build_table(runs: Sequence[Path], *, seed: int, missing: Mapping[Path, str]) -> dict[str, Any]:
    """Overrides and metrics of each run, and its paired difference to the first that has a report.

    Args:
        runs: of a sweep; at least one with a report.
        seed: of the bootstrap.
        missing: why a run has no report, for each that has none.

    Returns:
        ``changed``: keys that differ between runs; ``first``: name of the run that the others are compared with; ``runs``: ``name``,
        ``overrides``, ``metrics``, ``against_first``, and ``missing``: why the run has no numbers, else ``None``.
    """
    overrides = {run: _overrides(run) for run in runs}
    known = dict.fromkeys(key for each in overrides.values() for key in each)
    changed = [key for key in known if len({each.get(key) for each in overrides.values()}) > 1]
    loaded = {run: load(run / REPORT, run.name) for run in runs if run not in missing}
    first = next(iter(loaded.values()))
    rows = []
    for run in runs:
        report = loaded.get(run)
        rows.append(
            {
                "name": run.name,
                "overrides": {key: overrides[run].get(key) for key in changed},
                "metrics": {} if report is None else report.report["metrics"],
                "against_first": None if report is None or report is first else _differences(first, report, seed),
                "missing": missing.get(run),
            }
        )
    return {"changed": changed, "first": first.name, "runs": rows}


def markdown(result: Mapping[str, Any]) -> str:
    """One row a run; a star marks a difference to the first run whose 95 % interval excludes zero."""
    changed, first = result["changed"], result["first"]
    keys = counted_by_any(row["metrics"] for row in result["runs"])
    lines = [_line(["run", *changed, *keys]), _line(["---"] * (1 + len(changed) + len(keys)))]
    notes = []
    for row in result["runs"]:
        cells = [row["name"], *("" if row["overrides"][key] is None else row["overrides"][key] for key in changed)]
        for key in keys:
            difference = (row["against_first"] or {}).get(key)
            clear = difference and difference["low"] is not None and (difference["low"] > 0 or difference["high"] < 0)
            cells.append(spell(row["metrics"].get(key, {}).get("value")) + ("*" if clear else ""))
        lines.append(_line(cells))
        notes += [f"* run {row['name']}: {row['missing']}"] if row["missing"] else []
    notes += (
        []
        if len(lines) == 3
        else [f"* A star: the paired 95 % interval of the difference to run {first} excludes zero."]
    )
    return "\n".join([*lines, "", *notes, ""])


def _differences(first: Loaded, other: Loaded, seed: int) -> dict[str, Any]:
    keys = other.report["metrics"]
    return {key: paired(first, other, "metrics", key, bootstrap=BOOTSTRAP, seed=seed) for key in keys}


def _overrides(run: Path) -> dict[str, str]:
    try:
        words = yaml.safe_load((run / ".hydra" / "overrides.yaml").read_text(encoding="utf-8")) or []
    except (OSError, yaml.YAMLError) as error:
        raise FaunaError(
            f"{run}/.hydra/overrides.yaml expects a list of overrides, got {type(error).__name__}; restore it"
        ) from error
    pairs = [str(word).partition("=") for word in words]
    return {key: value for key, _, value in pairs if key != "out"}


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
