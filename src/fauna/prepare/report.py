"""For people: how many animals of which species there are, in which split, and why others were left out."""

import csv
import io
from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path

from fauna.prepare.reasons import REASONS
from fauna.prepare.settings import Settings
from fauna.prepare.split import BACK, TEST, TRAIN, VAL
from fauna.prepare.tables import read_columns
from fauna.prepare.workspace import Workspace, write_file

SPLITS = (TRAIN, VAL, TEST, BACK)
MANY, FEW = "tab:red", "tab:orange"
"""Colours of well-represented and of few-shot species (the paper's)."""


def write_report(manifest: list[Path], settings: Settings, workspace: Workspace) -> None:
    """Write ``balance.csv``, ``left_out.csv``, ``licences.csv`` and ``species.png`` into the report folder.

    Args:
        manifest: files of the set's manifest.
        settings: how few photographs make a few-shot species.
        workspace: the folders.
    """
    balance: dict[str, Counter[str]] = defaultdict(Counter)
    left_out: Counter[tuple[str, str]] = Counter()
    licences: Counter[tuple[str, str, str]] = Counter()
    columns = ["species", "split", "status", "reasons", "licence", "provenance", "dataset"]
    for file in manifest:
        for part in read_columns(file, columns):
            for species, split, status, reasons, licence, provenance, dataset in zip(*part.values(), strict=True):
                if status == "ok":
                    balance[species][split] += 1
                    licences[dataset, licence, provenance or ""] += 1
                else:
                    left_out.update((species, reason) for reason in reasons)
    folder = workspace.report
    rows = [[name, *(each[split] for split in SPLITS), each.total()] for name, each in sorted(balance.items())]
    _write(folder / "balance.csv", ["species", *SPLITS, "all"], rows)
    meaning = [
        [species, reason, count, REASONS[reason.split(":")[1]].meaning]
        for (species, reason), count in sorted(left_out.items())
    ]
    _write(folder / "left_out.csv", ["species", "reason", "rows", "meaning"], meaning)
    listed = [[*entry, count] for entry, count in sorted(licences.items())]
    _write(folder / "licences.csv", ["dataset", "licence", "provenance", "rows"], listed)
    _draw(folder / "species.png", {name: each.total() for name, each in balance.items()}, settings.split.few_shot_below)


def _write(path: Path, header: list[str], rows: list[list]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    write_file(path, text.getvalue().encode())


def _draw(path: Path, counts: Mapping[str, int], few_shot_below: int) -> None:
    """Bars of the species, the most frequent first, on a logarithmic scale."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = sorted(counts, key=lambda name: (-counts[name], name))
    figure = Figure(figsize=(max(4.0, 0.16 * len(names) + 1.5), 3.6), layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes = figure.subplots()
    colours = [FEW if counts[name] < few_shot_below else MANY for name in names]
    axes.bar(range(len(names)), [counts[name] for name in names], color=colours)
    axes.set_yscale("log")
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    axes.set_ylabel("animals")
    axes.set_title(
        f"{len(names)} species, {sum(counts.values()):,} animals; orange: fewer than {few_shot_below}", fontsize=9
    )
    picture = io.BytesIO()
    canvas.print_figure(picture, format="png", dpi=120, metadata={"Software": None})
    write_file(path, picture.getvalue())
