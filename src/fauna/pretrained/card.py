"""The texts that ship beside weights: the model card and the measured metrics."""

from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from string import Template
from typing import Any

from fauna.evaluation.report_md import counted, spell
from fauna.pretrained.provenance import ModelFile, Provenance

FRAME_KEYS = ("global_flip",)
"""Of a report, about the run and not about what ships: that has its head at +z."""

DIGITS = 6
"""Decimals of the shipped metrics."""


def card(**facts: str) -> str:
    """The model card.

    Args:
        facts: a text for every ``$name`` of ``card_template.md``.
    """
    template = files("fauna.pretrained").joinpath("card_template.md").read_text(encoding="utf-8")
    return Template(template).substitute(facts)


def data_section(found: Provenance) -> str:
    """What a model learned from, with makers and licences of model files."""
    parts = []
    if found.zoo is not None:
        parts.append(
            "* **The zoo**: procedural animals drawn by the package itself (`fauna.zoo`), "
            f"{found.zoo['photos_per_species']} pictures of each species, seed {found.zoo['seed']}, {found.zoo['image_size']} pixels."
        )
    if found.photos_per_model is not None:
        parts.append(
            f"* **Rigged models**, photographed by the package (`fauna.models3d`), {found.photos_per_model} pictures of each:"
        )
        parts.append("\n" + "\n".join(_table(("file", "species", "by", "licence", "seen in training"), _rows(found))))
    return "\n".join(parts)


def metrics_of(reports: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The measured numbers of some reports, rounded: what ``metrics.json`` holds.

    Args:
        reports: contents of ``report.json`` of ``fauna-eval``.
    """
    return [_of_report(report) for report in reports]


def metrics_section(measured: Sequence[Mapping[str, Any]]) -> str:
    """Tables of :func:`metrics_of`, baselines beside the model."""
    parts = []
    for report in measured:
        names = list(report["baselines"])
        groups = [(f"{report['split']} photographs", report, names)]
        if "held_out" in report:
            groups.append(("held-out species", report["held_out"], []))
        for title, group, baselines in groups:
            others = [report["baselines"][name]["metrics"] for name in baselines]
            parts += [f"### {report['dataset']}, {title}", ""]
            if report["includes_training_photos"]:
                parts += ["**These photographs include some that the model was trained on.**", ""]
            header = ("key", "value", "95 % interval", "n", *(f"`{name}`" for name in baselines))
            parts += [*_table(header, _metric_rows(group["metrics"], others)), ""]
    return "\n".join(parts).rstrip()


def _rows(found: Provenance) -> list[tuple[str, ...]]:
    def row(file: ModelFile, seen: str) -> tuple[str, ...]:
        return (f"`{file.name}.glb`", file.species, file.maker, file.licence, seen)

    return [row(file, "yes") for file in found.trained] + [row(file, "no") for file in found.held_out]


def _of_report(report: Mapping[str, Any]) -> dict[str, Any]:
    protocol = report["protocol"]
    content: dict[str, Any] = {
        "dataset": protocol["dataset"]["identity"],
        "dataset_sha256": protocol["dataset"]["sha256"],
        "split": protocol["split"],
        "photos": protocol["photos"],
        "includes_training_photos": bool(protocol["dataset"]["training_photos"]["included"]),
        "size": protocol["size"],
        "seed": protocol["seed"],
        "pairs": protocol["pairs"],
        "bootstrap": protocol["bootstrap"],
        "versions": protocol["versions"],
        **_group(report),
    }
    if "held_out" in report:
        content["held_out"] = _group(report["held_out"])
    content["baselines"] = {
        name: {"metrics": _metrics(each["metrics"])} for name, each in sorted(report["baselines"].items())
    }
    return content


def _group(scored: Mapping[str, Any]) -> dict[str, Any]:
    species = {name: _metrics(each["metrics"]) for name, each in sorted(scored["species"].items())}
    return {"metrics": _metrics(scored["metrics"]), "species": species}


def _metrics(metrics: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: {name: round(each, DIGITS) if isinstance(each, float) else each for name, each in metrics[key].items()}
        for key in counted(metrics)
        if key not in FRAME_KEYS
    }


def _metric_rows(
    metrics: Mapping[str, Mapping[str, Any]], others: Sequence[Mapping[str, Mapping[str, Any]]]
) -> list[tuple[str, ...]]:
    rows = []
    for key, row in metrics.items():
        beside = (spell(other.get(key, {}).get("value")) for other in others)
        span = f"{spell(row['low'])} to {spell(row['high'])}"
        rows.append((f"`{key}`", spell(row["value"]), span, str(row["n"]), *beside))
    return rows


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    lines = [header, ["---"] * len(header), *rows]
    return ["| " + " | ".join(cells) + " |" for cells in lines]
