"""The report as one HTML page that needs no network: style and pictures are inside."""

import html
import json
from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any

from fauna.evaluation.cases import COLUMNS, DrawnCase, draw_cases
from fauna.evaluation.protocol import training_warning
from fauna.evaluation.reading import MODEL, read_predictions
from fauna.evaluation.report_cards import TITLES, cards, percent, verdict
from fauna.evaluation.report_md import Table, tables
from fauna.evaluation.report_style import STYLE
from fauna.evaluation.scoring import Scorer
from fauna.evaluation.subjects import HELD_OUT, SEEN

OPEN_SPECIES = 3
"""Species whose pictures are shown at once; those of the others are folded."""
EARLY, LAST = ("Baselines", "By species", "All metrics", "Probe", "Left out"), "Published"

LEGEND = (
    '<p class="soft">Of each species the best, the middle and the worst photograph: by outline or, without masks, by the same spots on another animal.</p>'
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
    predictions = {prediction.name: prediction for prediction in read_predictions(scorer.folder, MODEL)}
    body = [_top(report), '<div id="pictures"></div>']
    for group, title in ((SEEN, "Pictures"), (HELD_OUT, "Pictures of species never seen in training")):
        if images.get(group):
            drawn = draw_cases(images[group], scorer.samples, scorer.pictures, predictions, species=pictures)
            body.append(_cases(title, drawn))
    body.append('<div id="tables"></div>')
    shown = tables(report)
    for start in EARLY:
        body += [_section(table.title, _table(table)) for table in shown if table.title.startswith(start)]
    body.append(_protocol(report))
    others = [table for table in shown if not table.title.startswith((*EARLY, LAST))]
    body += [_folded(table.title, _table(table)) for table in others]
    published = "".join(_table(table) for table in shown if table.title.startswith(LAST))
    body.append(
        _folded("Numbers of the paper beside ours", published + _differences(report["published"]["differences"]))
    )
    run = html.escape(str(report["protocol"]["checkpoint"]["run"]))
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>fauna evaluation: {run}</title><style>{STYLE}</style></head><body>\n"
        + "\n".join(body)
        + "\n</body></html>\n"
    )


def _top(report: Mapping[str, Any]) -> str:
    protocol = report["protocol"]
    checkpoint, dataset = protocol["checkpoint"], protocol["dataset"]
    step = "" if checkpoint["step"] is None else f"step {checkpoint['step']}, "
    warning = training_warning(dataset)
    shown = f'<p class="warn">{html.escape(warning[0].upper() + warning[1:])}.</p>' if warning else ""
    return (
        f"<h1>How good is {html.escape(str(checkpoint['run']))}?</h1>"
        f"<p>A model that turns one photograph of an animal into a 3D one, tried on {_tried_on(report)}; "
        "species count equally.</p>"
        f'<p class="soft">{html.escape(checkpoint["file"])}, {step}'
        f"{html.escape(dataset['identity'])}, split {html.escape(protocol['split'])}.</p>{shown}{verdict(report)}"
        '<nav><a href="#pictures">pictures</a><a href="#tables">all numbers</a><a href="#protocol">protocol</a></nav>'
        f'{cards(report)}<p class="soft">The range beside a number is its 95 % interval: how far it moves with the photographs it is '
        "measured on. Average animal: the mean shape, seen from where the model sees the animal.</p>"
    )


def _tried_on(report: Mapping[str, Any]) -> str:
    photos = report["protocol"]["photos"]
    counts = [f"{photos[SEEN]} photographs of {len(report['species'])} species"] if SEEN in photos else []
    if HELD_OUT in photos:
        what = "" if counts else " photographs"
        counts.append(
            f"{photos[HELD_OUT]}{what} of {len(report[HELD_OUT]['species'])} species it has never seen in training"
        )
    return " and on ".join(counts)


def _table(table: Table) -> str:
    note = f'<p class="soft">{_bold(table.note)}</p>' if table.note else ""
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in table.header)
    rows = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows)
    return f'{note}<div class="wide"><table><tr>{head}</tr>{rows}</table></div>'


def _section(title: str, inside: str) -> str:
    return f"<h2>{html.escape(title)}</h2>{inside}"


def _folded(title: str, inside: str) -> str:
    return f"<details><summary>{html.escape(title)}</summary>{inside}</details>"


def _bold(text: str) -> str:
    """Escaped text with ``**words**`` in bold."""
    parts = html.escape(text).split("**")
    return "".join(f"<b>{part}</b>" if place % 2 else part for place, part in enumerate(parts))


def _differences(differences: Sequence[str]) -> str:
    items = "".join(f"<li>{html.escape(text)}</li>" for text in differences)
    return f"<h3>Differences of protocol</h3><ul>{items}</ul>"


def _cases(title: str, cases: Sequence[DrawnCase]) -> str:
    by_species = [_species_cases(name, list(rows)) for name, rows in groupby(cases, key=lambda case: case.species)]
    parts = [f"<h2>{title}</h2>", LEGEND, *by_species[:OPEN_SPECIES]]
    if by_species[OPEN_SPECIES:]:
        parts.append(_folded(f"{len(by_species) - OPEN_SPECIES} more species", "\n".join(by_species[OPEN_SPECIES:])))
    return "\n".join(parts)


def _species_cases(species: str, cases: Sequence[DrawnCase]) -> str:
    heads = "".join(f"<span>{name}</span>" for name in COLUMNS)
    parts = [f'<h3>{html.escape(species)}</h3><div class="heads">{heads}</div>']
    for case in cases:
        score = "" if case.score is None else f", {TITLES[case.key].lower()} {percent(case.score)}"
        source = f", keypoints from {case.source}" if case.source else ""
        caption = html.escape(f"{case.rank}: {case.name}{score}{source}")
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
