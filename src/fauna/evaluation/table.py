"""``fauna-eval table MULTIRUN_FOLDER``: ablations and bank sizes from the runs of one sweep, in one table."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from fauna.errors import FaunaError
from fauna.evaluation.compare import Loaded, load, paired, split_arguments, whole
from fauna.evaluation.report_md import counted, spell
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
        FaunaError: for wrong arguments, or a folder without runs.
    """
    if not arguments or arguments[0] in ("-h", "--help"):
        print(f"usage: {USAGE}\nRuns without {REPORT}/report.json are evaluated first.")
        return
    folders, options = split_arguments(arguments, {"seed": "0"}, USAGE)
    words = [word for word in folders if "=" not in word]
    overrides = [word for word in folders if "=" in word]
    if len(words) != 1:
        raise FaunaError(f"table: expected one folder, got {len(words)}; usage: {USAGE}")
    sweep = Path(words[0])
    runs = find_runs(sweep)
    for run in runs:
        if not (run / REPORT / "report.json").is_file():
            print(f"evaluating {run}")
            evaluate(run, run / REPORT, [*overrides, f"seed={options['seed']}"])
    result = build_table(runs, seed=whole("seed", options["seed"]))
    write_json(result, sweep / "table.json")
    (sweep / "table.md").write_text(markdown(result), encoding="utf-8")
    print(markdown(result))
    print(f"table: {sweep / 'table.md'}")


def find_runs(sweep: Path) -> list[Path]:
    """Folders of the runs of a sweep, in the order of the jobs.

    Raises:
        FaunaError: when there is none that can be evaluated.
    """
    found = [path.parent.parent for path in sweep.glob("*/.hydra/overrides.yaml")]
    usable = [run for run in found if (run / "weights.safetensors").is_file() or (run / "checkpoints").is_dir()]
    if not usable:
        raise FaunaError(
            f"table: expected the folder of a sweep (fauna-train -m ...) whose runs hold weights, got {sweep} without any; "
            "check the path"
        )
    return sorted(
        usable, key=lambda run: (not run.name.isdigit(), int(run.name) if run.name.isdigit() else 0, run.name)
    )


def build_table(runs: Sequence[Path], *, seed: int) -> dict[str, Any]:
    """Overrides and metrics of each run, and its paired difference to the first.

    Args:
        runs: with a report each.
        seed: of the bootstrap.

    Returns:
        ``changed``: keys that differ between runs; ``runs``: ``name``, ``overrides``, ``metrics``, ``against_first``.
    """
    overrides = [_overrides(run) for run in runs]
    changed = [
        key
        for key in dict.fromkeys(key for each in overrides for key in each)
        if len({e.get(key) for e in overrides}) > 1
    ]
    loaded = [load(run / REPORT) for run in runs]
    rows = []
    for run, given, report in zip(runs, overrides, loaded, strict=True):
        metrics = report.report["metrics"]
        rows.append(
            {
                "name": run.name,
                "overrides": {key: given.get(key) for key in changed},
                "metrics": metrics,
                "against_first": _differences(loaded[0], report, metrics, seed) if report is not loaded[0] else None,
            }
        )
    return {"changed": changed, "runs": rows}


def markdown(result: Mapping[str, Any]) -> str:
    """One row a run; a star marks a difference to the first run whose 95 % interval excludes zero."""
    changed = result["changed"]
    keys = counted(result["runs"][0]["metrics"])
    lines = [_line(["run", *changed, *keys]), _line(["---"] * (1 + len(changed) + len(keys)))]
    for row in result["runs"]:
        cells = [row["name"], *(str(row["overrides"][key] or "") for key in changed)]
        for key in keys:
            value = row["metrics"].get(key, {})
            difference = (row["against_first"] or {}).get(key)
            clear = difference and difference["low"] is not None and (difference["low"] > 0 or difference["high"] < 0)
            cells.append(spell(value.get("value")) + ("*" if clear else ""))
        lines.append(_line(cells))
    note = "A star: the paired 95 % interval of the difference to the first run excludes zero."
    return "\n".join([*lines, "", note, ""])


def _differences(first: Loaded, other: Loaded, metrics: Mapping[str, Any], seed: int) -> dict[str, Any]:
    return {key: paired(first, other, "metrics", key, bootstrap=BOOTSTRAP, seed=seed) for key in metrics}


def _overrides(run: Path) -> dict[str, str]:
    try:
        words = yaml.safe_load((run / ".hydra" / "overrides.yaml").read_text(encoding="utf-8")) or []
    except (OSError, yaml.YAMLError) as error:
        raise FaunaError(f"{run}/.hydra/overrides.yaml expects a list of overrides, got {error}; restore it") from error
    pairs = [str(word).partition("=") for word in words]
    return {key: value for key, _, value in pairs if key != "out"}


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
