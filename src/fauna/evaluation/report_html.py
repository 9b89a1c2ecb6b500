"""The report as one HTML page that needs no network: style and pictures are inside."""

import html
import json
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from fauna.evaluation.cases import COLUMNS, DrawnCase, draw_cases
from fauna.evaluation.draw import CELL
from fauna.evaluation.protocol import lower_is_better
from fauna.evaluation.report_md import Table, counted, spell, tables
from fauna.evaluation.scoring import Scorer
from fauna.evaluation.stored import read_predictions
from fauna.evaluation.subjects import HELD_OUT, SEEN

STYLE = """
:root { color-scheme: light; --ink: #1d2a24; --soft: #5d6b64; --line: #dfe5e1; --tint: #f4f7f5; --leaf: #2d7a53; }
* { box-sizing: border-box; }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); margin: 0 auto; max-width: 1180px; padding: 32px 24px 80px; }
h1 { font-size: 28px; margin: 0 0 4px; } h2 { font-size: 19px; margin: 44px 0 10px; } h3 { font-size: 15px; margin: 18px 0 6px; }
p, li { max-width: 92ch; } .soft { color: var(--soft); } .warn { color: #a33; font-weight: 600; }
.cards { display: flex; flex-wrap: wrap; gap: 12px; margin: 20px 0; }
.card { border: 1px solid var(--line); border-radius: 8px; padding: 12px 16px; min-width: 168px; }
.card b { display: block; font-size: 26px; font-variant-numeric: tabular-nums; color: var(--leaf); }
.card span { display: block; font-size: 12px; color: var(--soft); }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 4px 12px 4px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
th { color: var(--soft); font-weight: 600; background: var(--tint); } td:first-child, th:first-child { padding-left: 6px; }
.case { margin: 0 0 10px; } .case img { display: block; border: 1px solid var(--line); max-width: 100%; }
.case figcaption { font-size: 12px; color: var(--soft); } .heads { display: flex; font-size: 12px; color: var(--soft); }
details > summary { cursor: pointer; color: var(--leaf); } pre { font-size: 12px; overflow-x: auto; background: var(--tint); padding: 12px; }
nav a { margin-right: 14px; color: var(--leaf); } .key i { display: inline-block; width: 11px; height: 11px; margin: 0 4px 0 12px; }
"""

LEGEND = (
    '<p class="soft key">silhouettes:<i style="background:#96beA0"></i>agree<i style="background:#d64541"></i>animal missed'
    '<i style="background:#f6c444"></i>spill. Keypoints: ring annotated, dot transferred from the best other photograph of the '
    "species; green within 0.1 crop sides.</p>"
)


def html_report(
    report: Mapping[str, Any], images: Mapping[str, Mapping[str, Any]], scorer: Scorer, *, pictures: int
) -> str:
    """The page.

    Args:
        report: content of ``report.json`` so far.
        images: scores by group and photograph.
        scorer: holds samples and thumbnails.
        pictures: species with pictures, of each group.
    """
    predictions = {prediction.name: prediction for prediction in read_predictions(scorer.folder, "model")}
    body = [_top(report)]
    shown = tables(report)
    early = ("All metrics", "By species", "Baselines", "Probe", "Published")
    body += [_table(table) for table in shown if table.title.startswith(early)]
    body.append(_differences(report["published"]["differences"]))
    for group, title in ((SEEN, "Cases"), (HELD_OUT, "Cases of held-out species")):
        if group in images:
            cases = draw_cases(images[group], scorer.samples, scorer.pictures, predictions, species=pictures)
            body.append(_cases(title, cases))
    body.append(_protocol(report))
    body += [_table(table) for table in shown if not table.title.startswith(early)]
    run = html.escape(str(report["protocol"]["checkpoint"]["run"]))
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>fauna evaluation: {run}</title><style>{STYLE}</style></head><body>\n"
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def _top(report: Mapping[str, Any]) -> str:
    protocol = report["protocol"]
    checkpoint, dataset = protocol["checkpoint"], protocol["dataset"]
    total = sum(protocol["photos"].values())
    cards = []
    for key in counted(report["metrics"]):
        row = report["metrics"][key]
        if row["value"] is not None and not lower_is_better(key) and len(cards) < 6:
            span = f"{spell(row['low'])} to {spell(row['high'])}, n = {row['n']}"
            cards.append(f'<div class="card"><b>{spell(row["value"])}</b>{html.escape(key)}<span>{span}</span></div>')
    warning = ""
    if dataset["includes_training_photos"]:
        warning = '<p class="warn">The photographs include those the checkpoint was trained on.</p>'
    return (
        f"<h1>{html.escape(str(checkpoint['run']))}</h1>"
        f'<p class="soft">{html.escape(checkpoint["file"])}, step {checkpoint["step"]}, on {total} photographs of '
        f"{html.escape(dataset['identity'])} ({html.escape(protocol['split'])}); every photograph counted once, species equally.</p>"
        f'{warning}<nav><a href="#cases">cases</a><a href="#protocol">protocol</a></nav>'
        f'<div class="cards">{"".join(cards)}</div>'
    )


def _table(table: Table) -> str:
    note = f'<p class="soft">{_bold(table.note)}</p>' if table.note else ""
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in table.header)
    rows = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows)
    inside = f'{note}<div class="wide"><table><tr>{head}</tr>{rows}</table></div>'
    if table.title.startswith("Keypoints of"):
        return f"<details><summary>{html.escape(table.title)}</summary>{inside}</details>"
    return f"<h2>{html.escape(table.title)}</h2>{inside}"


def _bold(text: str) -> str:
    """Escaped text with ``**words**`` in bold."""
    parts = html.escape(text).split("**")
    return "".join(f"<b>{part}</b>" if place % 2 else part for place, part in enumerate(parts))


def _differences(differences: Sequence[str]) -> str:
    items = "".join(f"<li>{html.escape(text)}</li>" for text in differences)
    return f"<h3>Differences of protocol</h3><ul>{items}</ul>"


def _cases(title: str, cases: Sequence[DrawnCase]) -> str:
    heads = "".join(f'<span style="width:{CELL}px">{name}</span>' for name in COLUMNS)
    parts = [f'<h2 id="{"cases" if title == "Cases" else "held-out"}">{title}</h2>', LEGEND]
    for species, rows in groupby(cases, key=lambda case: case.species):
        parts.append(f'<h3>{html.escape(species)}</h3><div class="heads">{heads}</div>')
        for case in rows:
            source = f", keypoints from {case.source}" if case.source else ""
            caption = html.escape(f"{case.rank}: {case.name}, IoU {spell(case.score)}{source}")
            picture = f'<img alt="{caption}" src="data:image/png;base64,{case.png}">'
            parts.append(f'<figure class="case">{picture}<figcaption>{caption}</figcaption></figure>')
    return "\n".join(parts)


def _protocol(report: Mapping[str, Any]) -> str:
    protocol = report["protocol"]
    rules = "".join(
        f"<li><b>{html.escape(name)}</b>: {html.escape(rule)}</li>" for name, rule in protocol["rules"].items()
    )
    raw = html.escape(json.dumps({key: value for key, value in protocol.items() if key != "definitions"}, indent=1))
    return (
        f'<h2 id="protocol">Protocol</h2><ul>{rules}</ul>'
        f"<details><summary>Dataset, checkpoint, seeds, versions</summary><pre>{raw}</pre></details>"
    )
