"""Writes ``report.json``, ``images.json``, ``tallies.npz``, ``report.md`` and ``report.html`` of a predictions folder."""

import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fauna.data.feature_cache import write_atomically
from fauna.evaluation.protocol import build_protocol
from fauna.evaluation.published import DIFFERENCES, HERE, ROWS
from fauna.evaluation.report_html import html_report
from fauna.evaluation.report_md import headline, markdown_report
from fauna.evaluation.scoring import ScoreOptions, Scorer
from fauna.evaluation.subjects import HELD_OUT
from fauna.evaluation.tallies import FILE as TALLIES
from fauna.evaluation.tallies import write_tallies
from fauna.io.run_folder import write_json

FORMAT = 1


def write_reports(predictions: Path, folder: Path, options: ScoreOptions, *, pictures: int) -> dict[str, Any]:
    """Score a predictions folder and write all reports.

    Args:
        predictions: finished predictions folder.
        folder: that the reports are written into.
        options: of the scoring.
        pictures: species with pictures in the HTML report.

    Returns:
        The content of ``report.json``. All but ``timing`` is a function of the predictions folder and the options.

    Raises:
        FaunaError: when the predictions folder is missing, unfinished or damaged.
    """
    scorer = Scorer(folder=predictions, options=options)
    tables = scorer.tables()
    images, tallies = tables.pop("images"), tables.pop("tallies")
    report = {
        "format": FORMAT,
        "metrics": tables.pop("metrics"),
        "species": tables.pop("species"),
        **tables,
    }
    keys = {*report["metrics"], *report.get(HELD_OUT, {}).get("metrics", {})}
    report["protocol"] = build_protocol(scorer.facts, asdict(options), keys)
    report["published"] = {"from": HERE, "rows": published_rows(report), "differences": list(DIFFERENCES)}
    write_json(images, folder / "images.json")
    write_tallies(folder / TALLIES, tallies)
    started = time.monotonic()
    page = html_report(report, images, scorer, pictures=pictures)
    write_atomically(folder / "report.html", page.encode())
    scorer.seconds["report.html"] = round(time.monotonic() - started, 2)
    report["timing"] = {**scorer.facts["timing"], **scorer.seconds}
    write_atomically(folder / "report.md", markdown_report(report).encode())
    write_json(report, folder / "report.json")
    print(headline(report))
    print(f"report: {folder / 'report.html'} (tables also in report.md and report.json)")
    return report


def published_rows(report: dict[str, Any]) -> list[dict[str, Any]]:
    """The printed rows, and beside each value ours for the same species (``all``: the mean over our species)."""
    rows = []
    for row in ROWS:
        ours = {}
        for name, _ in row.columns:
            metrics = report["metrics"] if name == "all" else report["species"].get(name, {}).get("metrics", {})
            ours[name] = metrics.get(row.metric, {}).get("value")
        rows.append({**asdict(row), "columns": dict(row.columns), "ours": ours})
    return rows
