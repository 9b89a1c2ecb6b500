"""``python -m fauna.evaluation.conditions REPORT ROOT``: which photographs of a folder of crops are hard for a model.

What a photograph is like is read from its mask, its box and its keypoints, never from a prediction.
"""

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from fauna.cli import one_line_errors
from fauna.data.sources import FaunaFolder
from fauna.errors import FaunaError
from fauna.evaluation.reading import MODEL

USAGE = "usage: python -m fauna.evaluation.conditions REPORT_FOLDER DATA_ROOT [REPORT_FOLDER ...]"
METRICS = ("iou", "kt_pck@0.1")
BORDER = 0.02  # crop widths within which an animal touches the border of its photograph; as data.valid_margin
FEW_PAWS = 3
FEWEST = 3
REPLICATES = 2000

Sides = tuple[Float[np.ndarray, " photo"], Float[np.ndarray, " other"]]
"""Scores of the photographs of a species that fulfil a condition, and of those that do not."""
Column = tuple[str, str]
"""The model or a baseline, and a metric."""


@dataclass(frozen=True)
class Shown:
    """What is known of a photograph.

    Attributes:
        mask: of the crop.
        inside: left, top, right, bottom of the photograph in the crop, in crop widths; beyond (0, 1) where the crop lies inside.
        seen: names of the annotated keypoints; empty where there are none.
    """

    mask: Bool[np.ndarray, "height width"]
    inside: tuple[float, float, float, float]
    seen: frozenset[str]


def _cut(shown: Shown) -> bool | None:
    rows, columns = np.nonzero(shown.mask)
    height, width = shown.mask.shape
    left, top, right, bottom = shown.inside
    return bool(
        columns.min() / width < left + BORDER
        or rows.min() / height < top + BORDER
        or (columns.max() + 1) / width > right - BORDER
        or (rows.max() + 1) / height > bottom - BORDER
    )


def _taller(shown: Shown) -> bool | None:
    rows, columns = np.nonzero(shown.mask)
    return bool(np.ptp(rows) > np.ptp(columns))


def _few_paws(shown: Shown) -> bool | None:
    return sum(name.endswith("paw") for name in shown.seen) < FEW_PAWS if shown.seen else None


def _face(shown: Shown) -> bool | None:
    return {"left_eye", "right_eye"} <= shown.seen if shown.seen else None


def _from_behind(shown: Shown) -> bool | None:
    return "tailbase" in shown.seen and not {"left_eye", "right_eye", "nose"} & shown.seen if shown.seen else None


CONDITIONS: Mapping[str, Callable[[Shown], bool | None]] = {
    "cut by the photograph's border": _cut,
    "taller than wide (sitting, frontal)": _taller,
    "fewer than three paws annotated": _few_paws,
    "both eyes annotated (frontal)": _face,
    "tail base but neither eye nor nose (from behind)": _from_behind,
}
"""What is asked of a photograph; ``None``: it cannot be told."""


def describe(root: Path) -> dict[str, dict[str, bool | None]]:
    """Every photograph of a folder of crops by the name it has in a report, with the answer to each of :data:`CONDITIONS`."""
    source = FaunaFolder(root=str(root), photograph_pattern=r"(.+_\d+)_\d+")
    names = source.keypoint_names or ()
    found = {}
    for photos in source.categories().values():
        for photo in (*photos.train, *photos.val, *photos.test):
            raw = photo.source.read()
            box, points = raw.box, raw.keypoints
            inside = (
                (0.0, 0.0, 1.0, 1.0)
                if box is None
                else (
                    -box.x0 / box.width,
                    -box.y0 / box.height,
                    (box.photo_width - box.x0) / box.width,
                    (box.photo_height - box.y0) / box.height,
                )
            )
            seen = () if points is None else (name for name, point in zip(names, points, strict=True) if point[2] > 0)
            mask = np.asarray(raw.mask)
            shown = Shown(mask if mask.dtype == bool else mask > 127, inside, frozenset(seen))
            if not shown.mask.any():
                continue  # nothing can be said of it
            found[photo.name] = {title: ask(shown) for title, ask in CONDITIONS.items()}
    return found


def compare(report: Path, described: Mapping[str, Mapping[str, bool | None]]) -> list[dict[str, Any]]:
    """Scores of the photographs that fulfil each condition beside those of the same species that do not.

    Args:
        report: folder of an evaluation.
        described: of :func:`describe`.

    Returns:
        Rows of ``condition``, ``of`` (the model or a baseline of the report), ``metric``, ``n`` (yes, no), ``yes`` and ``no`` (means over
        species), ``difference``, ``low``, ``high`` (95 % bootstrap over photographs). Species with fewer than three photographs on
        either side are left out, and metrics that nothing has a score in.

    Raises:
        FaunaError: when it is no report, or one that knows none of the photographs.
    """
    species, columns = _scores(report, described)
    rows = []
    for title in CONDITIONS:
        for (method, metric), column in columns.items():
            sides: dict[str, tuple[list[float], list[float]]] = {}
            for name, score in column.items():
                answer = described[name][title]
                if answer is not None and score is not None:
                    sides.setdefault(species[name], ([], []))[0 if answer else 1].append(score)
            known = [(np.array(yes), np.array(no)) for yes, no in sides.values() if min(len(yes), len(no)) >= FEWEST]
            if known:
                n = (sum(len(yes) for yes, _ in known), sum(len(no) for _, no in known))
                rows.append({"condition": title, "of": method, "metric": metric, "n": n, **_difference(known)})
    return rows


def _scores(report: Path, known: Mapping[str, Any]) -> tuple[dict[str, str], dict[Column, dict[str, float | None]]]:
    """Species of a report's photographs among the known ones, and by method and metric their scores."""
    path = report / "images.json"
    try:
        rows = {name: row for name, row in json.loads(path.read_text("utf-8"))["metrics"].items() if name in known}
        species = {name: row["species"] for name, row in rows.items()}
        scores = {name: {**row.get("baselines", {}), MODEL: row["scores"]} for name, row in rows.items()}
        columns = {
            (method, metric): {name: of_photo.get(method, {}).get(metric) for name, of_photo in scores.items()}
            for metric in METRICS
            for method in dict.fromkeys((MODEL, *(method for of_photo in scores.values() for method in of_photo)))
        }
        told = [score for column in columns.values() for score in column.values() if score is not None]
        if not all(isinstance(kind, str) for kind in species.values()) or not np.isfinite(np.array(told, float)).all():
            raise ValueError("a species that is no text, or a score that is no finite number")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FaunaError(
            f"expected the folder of a fauna-eval report with the scores of each photograph in {path.name}, got {report} "
            f"({type(error).__name__}); check the path, or score again with fauna-eval predictions={report}/predictions out=FOLDER"
        ) from error
    if not rows:
        raise FaunaError(
            f"expected a report on photographs of the folder, got {report} without any of them; name their folder"
        )
    return species, columns


def _difference(sides: Sequence[Sides]) -> dict[str, float]:
    rng = np.random.default_rng(0)
    drawn = [
        [each[rng.integers(len(each), size=(REPLICATES, len(each)))].mean(axis=1) for each in pair] for pair in sides
    ]
    low, high = np.percentile(np.mean([yes - no for yes, no in drawn], axis=0), (2.5, 97.5))
    yes, no = (float(np.mean([pair[side].mean() for pair in sides])) for side in (0, 1))
    return {"yes": yes, "no": no, "difference": yes - no, "low": float(low), "high": float(high)}


def markdown(report: Path, rows: Sequence[Mapping[str, Any]]) -> str:
    """A table of :func:`compare`."""
    lines = [
        f"**{report.name}**",
        "",
        "| photographs | of | metric | n | mean | the others | difference |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        n = row["n"]
        lines.append(
            f"| {row['condition']} | {row['of']} | {row['metric']} | {n[0]} of {n[0] + n[1]} | {row['yes']:.3f} | {row['no']:.3f} "
            f"| {row['difference']:+.3f} ({row['low']:+.3f} to {row['high']:+.3f}) |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Entry point."""
    with one_line_errors("fauna-eval"):
        if {"-h", "--help"} & set(sys.argv[1:]):
            print(USAGE)
            return
        if len(sys.argv) < 3:
            raise FaunaError(f"expected a report and a folder of crops, got {len(sys.argv) - 1} words; {USAGE}")
        described = describe(Path(sys.argv[2]).expanduser())
        reports = [Path(word).expanduser() for word in (sys.argv[1], *sys.argv[3:])]
        for report, rows in [(report, compare(report, described)) for report in reports]:
            print(markdown(report, rows))


if __name__ == "__main__":
    main()
