"""The first screen of the HTML report: what the main numbers mean in plain words, beside the baselines."""

import html
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fauna.evaluation.report_md import metrics_of
from fauna.evaluation.subjects import HELD_OUT, SEEN


@dataclass(frozen=True)
class Card:
    """One main number, a share from 0 to 1 of which more is better.

    Attributes:
        key: of the metric.
        title: a few words.
        meaning: one sentence without terms of the field.
        shared_with: baselines that take what is measured over from the model, and so say nothing about it.
    """

    key: str
    title: str
    meaning: str
    shared_with: tuple[str, ...] = ()


CARDS = (
    Card("iou", "Outline", "Overlap of the outline of the 3D animal, drawn over the photograph, with the animal's own. 100\N{NO-BREAK SPACE}% is a perfect fit."),
    Card(
        "kt_pck@0.1",
        "Same spot on another animal",
        "A spot marked on one photograph, say the nose, is found on another through the two 3D surfaces. Share of hits: at most a tenth of "
        "the picture away.",
    ),
    Card("pck@0.1", "Body parts", "Eyes, knees, tail and the like are pointed out on photographs not used to learn where they are. Share of hits."),
    Card("novel_view_iou", "Shape from other sides", "Overlap of the outlines when model and true animal are both seen from eight other sides."),
    Card("azimuth_within_30", "Direction", "Share of photographs whose animal is turned the right way, at most 30 degrees off.", ("mean_shape",)),
    Card("volume_iou", "Solid shape", "Overlap of the body itself with the true one, inside included. The hardest of these numbers."),
)  # fmt: skip
TITLES = {card.key: card.title for card in CARDS}

PLAIN = {
    "mean_shape": "average animal",
    "untrained": "untrained network",
    "feature_matching": "2D matching, no 3D",
    "box_copy": "copying positions",
}
"""Baselines in everyday words."""


def cards(report: Mapping[str, Any]) -> str:
    """A card for each main number that the report has."""
    shown = [_card(card, report) for card in CARDS if _value(_own(report), card.key) is not None]
    return f'<div class="cards">{"".join(shown)}</div>'


def verdict(report: Mapping[str, Any]) -> str:
    """One sentence a main number: how the model stands against the best baseline, judged by the model's 95 % interval."""
    found: dict[str, list[str]] = {
        "above every baseline": [],
        "level with the best baseline": [],
        "below a baseline": [],
    }
    for card in CARDS:
        row = _own(report).get(card.key, {})
        others = list(_baselines(card, report).values())
        if not others or row.get("value") is None or row.get("low") is None:
            continue
        place = 0 if row["low"] > max(others) else 2 if row["high"] < max(others) else 1
        found[list(found)[place]].append(card.title.lower())
    parts = [f"<b>{words}</b> in {_joined(titles)}" for words, titles in found.items() if titles]
    return f"<p>Against the baselines below, this model is {'; '.join(parts)}.</p>" if parts else ""


def percent(share: float) -> str:
    """A share in whole percent, on one line.

    >>> percent(0.754).replace("\N{NO-BREAK SPACE}", " ")
    '75 %'
    """
    return f"{100 * share:.0f}\N{NO-BREAK SPACE}%"


def _card(card: Card, report: Mapping[str, Any]) -> str:
    row = _own(report)[card.key]
    count = f"{row['n']} photograph{'s' if row['n'] != 1 else ''}"
    span = count if row["low"] is None else f"{100 * row['low']:.0f} to {percent(row['high'])}, {count}"
    bars = [_bar("this model", row["value"], own=True)]
    held_out = _value(metrics_of(report, HELD_OUT), card.key)
    if held_out is not None and _group(report) == SEEN:
        bars.append(_bar("species never seen", held_out, own=True))
    bars += [_bar(PLAIN.get(name, name), value, own=False) for name, value in _baselines(card, report).items()]
    return (
        f'<section class="card"><h3>{html.escape(card.title)}</h3><div class="value">{percent(row["value"])}<small>{span}</small></div>'
        f'<p class="soft">{html.escape(card.meaning)}</p><div class="bars">{"".join(bars)}</div></section>'
    )


def _bar(name: str, value: float, *, own: bool) -> str:
    label = f"<b>{html.escape(name)}</b>" if own else f"<span>{html.escape(name)}</span>"
    style = ' class="own"' if own else ""
    return f'{label}<i{style} style="width:{100 * min(max(value, 0.0), 1.0):.1f}%"></i><u>{percent(value)}</u>'


def _baselines(card: Card, report: Mapping[str, Any]) -> dict[str, float]:
    group = _group(report)
    found = {name: _value(metrics_of(each, group), card.key) for name, each in report["baselines"].items()}
    return {name: value for name, value in found.items() if value is not None and name not in card.shared_with}


def _group(report: Mapping[str, Any]) -> str:
    """The photographs that the cards are about: of species never seen where there are no others."""
    return SEEN if report["metrics"] else HELD_OUT


def _own(report: Mapping[str, Any]) -> Mapping[str, Any]:
    return metrics_of(report, _group(report))


def _value(metrics: Mapping[str, Any], key: str) -> float | None:
    return metrics.get(key, {}).get("value")


def _joined(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
