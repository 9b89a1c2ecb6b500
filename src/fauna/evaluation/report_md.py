"""The report as Markdown tables; the HTML report shows the same tables."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fauna.evaluation.protocol import training_warning
from fauna.evaluation.subjects import HELD_OUT, SEEN
from fauna.metrics.keys import DEFINITIONS, better

ORDER = tuple(DEFINITIONS)


@dataclass(frozen=True)
class Table:
    """A table of texts.

    Attributes:
        title: heading.
        note: one paragraph above the table, may be empty.
        header: of the columns.
        rows: as long as the header.
    """

    title: str
    note: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


def spell(value: float | None) -> str:
    """A number for a table; a dash where there is none.

    >>> spell(0.4321), spell(12.34), spell(None)
    ('0.432', '12.3', '–')
    """
    if value is None:
        return "–"
    return f"{value:.3f}" if abs(value) < 10 else f"{value:.1f}"


def ordered(keys: Iterable[str]) -> list[str]:
    """Keys in the order of the definitions, settings beside their plain key."""

    def rank(key: str) -> tuple[int, str]:
        places = [place for place, name in enumerate(ORDER) if key == name or key.startswith((f"{name}_", f"{name}@"))]
        return (max(places, default=len(ORDER)), key)

    return sorted(keys, key=rank)


def counted(metrics: Mapping[str, Any]) -> list[str]:
    """Keys that count at least one photograph, in order; tables leave the others out, ``report.json`` does not."""
    return ordered(key for key, row in metrics.items() if row["n"])


def metrics_of(scored: Mapping[str, Any], group: str) -> Mapping[str, Any]:
    """Metrics of a group of photographs in a report, or in one of its baselines; empty where the group is missing.

    >>> metrics_of({"metrics": {"iou": 1}}, "metrics"), metrics_of({"metrics": {"iou": 1}}, "held_out")
    ({'iou': 1}, {})
    """
    return (scored if group == SEEN else scored.get(group, {})).get("metrics", {})


def headline(report: Mapping[str, Any]) -> str:
    """Some lines for the terminal."""
    lines = []
    for group, scored in _groups(report):
        for key in counted(scored["metrics"]):
            row = scored["metrics"][key]
            lines.append(f"{group:10s} {key:32s} {spell(row['value']):>7s}  n={row['n']}")
    return "\n".join(lines)


def markdown_report(report: Mapping[str, Any]) -> str:
    """The whole report."""
    parts = ["# Evaluation", "", *_facts(report), ""]
    for table in tables(report):
        parts += [f"## {table.title}", ""]
        parts += [table.note, ""] if table.note else []
        parts += [_line(table.header), _line(["---"] * len(table.header)), *map(_line, table.rows), ""]
    parts += ["## Differences of protocol to the published numbers", ""]
    parts += [f"* {difference}" for difference in report["published"]["differences"]]
    return "\n".join(parts) + "\n"


def tables(report: Mapping[str, Any]) -> list[Table]:
    """All tables, in order."""
    found = []
    for group, scored in _groups(report):
        found.append(_metrics(f"All metrics, {group}", scored["metrics"]))
        found.append(_species(f"By species, {group}", scored["species"]))
    for group, (title, _) in zip((SEEN, HELD_OUT), _groups(report), strict=False):
        found.append(_baselines(title, group, report))
    for name, probe in report["probes"].items():
        found.append(_probe(name, probe))
    found += [_keypoints(name, row["keypoints"]) for name, row in report["species"].items() if row["keypoints"]]
    found.append(_left_out(report["left_out"]))
    found.append(
        Table(
            "What the keys mean",
            "",
            ("key", "meaning"),
            [(key, text or "see the documentation") for key, text in report["protocol"]["definitions"].items()],
        )
    )
    found.append(_published(report))
    return [table for table in found if table.rows]


def _groups(report: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    split = report["protocol"]["split"]
    groups: list[tuple[str, Mapping[str, Any]]] = [(f"{split} photographs", report)]
    return [*groups, ("held-out species", report["held_out"])] if "held_out" in report else groups


def _facts(report: Mapping[str, Any]) -> list[str]:
    protocol = report["protocol"]
    checkpoint, dataset = protocol["checkpoint"], protocol["dataset"]
    lines = [
        f"* checkpoint: {checkpoint['file']} of run {checkpoint['run']}, step {checkpoint['step'] or 'unknown'}, sha256 "
        f"{checkpoint['sha256'][:16]}, encoder {checkpoint['encoder']}",
        f"* dataset: {dataset['identity']}, split {protocol['split']}, "
        + ", ".join(f"{count} photographs under {name}" for name, count in protocol["photos"].items()),
        f"* seed {protocol['seed']}, at most {protocol['pairs']} ordered pairs per species, {protocol['bootstrap']} bootstrap "
        f"replicates, masks at {protocol['size']} pixels",
    ]
    if warning := training_warning(dataset):
        lines.append(f"* **{warning}**")
    lines += [f"* {name}: {rule}" for name, rule in protocol["rules"].items()]
    lines.append("* versions: " + ", ".join(f"{name} {version}" for name, version in protocol["versions"].items()))
    return lines


def _metrics(title: str, metrics: Mapping[str, Any]) -> Table:
    rows = []
    for key in counted(metrics):
        row = metrics[key]
        span = "–" if row["low"] is None else f"{spell(row['low'])} to {spell(row['high'])}"
        rows.append((key, spell(row["value"]), span, str(row["n"]), str(row.get("pairs", "")), better(key) or "–"))
    return Table(title, "", ("key", "value", "95 % interval", "images", "pairs", "better"), rows)


def _species(title: str, species: Mapping[str, Any]) -> Table:
    keys = ordered({key for row in species.values() for key in counted(row["metrics"])})
    rows = [(name, *(spell(row["metrics"].get(key, {}).get("value")) for key in keys)) for name, row in species.items()]
    return Table(title, "", ("species", *keys), rows)


def _baselines(title: str, group: str, report: Mapping[str, Any]) -> Table:
    """The model and the baselines on one group of photographs, ``metrics`` or ``held_out``."""
    baselines, own = report["baselines"], metrics_of(report, group)
    keys = counted(own)
    rows = [("the model", *(spell(own[key]["value"]) for key in keys))]
    for name, row in baselines.items():
        rows.append((name, *(spell(metrics_of(row, group).get(key, {}).get("value")) for key in keys)))
    note = " ".join(f"**{name}**: {row['description']}" for name, row in baselines.items())
    return Table(f"Baselines, {title}", note, ("", *keys), rows if baselines and keys else [])


def _probe(name: str, probe: Mapping[str, Any]) -> Table:
    rows = []
    for key in counted(probe["metrics"]):
        theirs = probe["model_on_the_same_photos"].get(key, {}).get("value")
        rows.append((key, spell(theirs), spell(probe["metrics"][key]["value"])))
    note = f"{probe['num_photos']} photographs; **{probe['label']}**."
    return Table(f"Probe: {name} freed", note, ("key", "the model", "fitted"), rows)


def _keypoints(species: str, keypoints: Mapping[str, Any]) -> Table:
    keys = ordered({key for row in keypoints.values() for key, value in row.items() if value["n"]})
    rows = [(name, *(spell(row.get(key, {}).get("value")) for key in keys)) for name, row in keypoints.items()]
    return Table(f"Keypoints of {species}", "", ("keypoint", *keys), rows)


def _published(report: Mapping[str, Any]) -> Table:
    rows = []
    for row in report["published"]["rows"]:
        for name, value in row["columns"].items():
            ours = row["ours"][name]
            rows.append((row["method"], row["dataset"], name, row["metric"], spell(value), spell(ours), row["source"]))
    note = (
        f"Theirs as printed ({report['published']['from']}); ours of this report, on other photographs and under another "
        "protocol, see below."
    )
    header = ("method", "their photographs", "species", "metric", "theirs", "ours, here", "printed in")
    return Table("Published numbers beside ours", note, header, rows)


def _left_out(rows: Sequence[Mapping[str, Any]]) -> Table:
    shown = []
    for row in rows:
        names = ", ".join(row["names"][:6]) + (", ..." if row["count"] > 6 else "")
        shown.append((row["of"], ", ".join(row["metrics"]), row["reason"], str(row["count"]), names))
    return Table("Left out", "", ("of", "metrics", "reason", "photographs", "names"), shown)


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
