"""``python -m fauna.plots.gallery REPORT --out FOLDER``: predictions chosen by lot, and the best and worst, as contact sheets."""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from fauna.cli import one_line_errors
from fauna.errors import FaunaError
from fauna.evaluation import draw
from fauna.evaluation.gather import MODEL, SAMPLES
from fauna.evaluation.prediction import Prediction
from fauna.evaluation.records import unpack_prediction, unpack_sample
from fauna.evaluation.store import ArrayStore
from fauna.io.contact_sheet import VIEWS, save_png
from fauna.metrics.sample import Sample
from fauna.random import derive_seed

COLUMNS = ("photograph", "mask and silhouette", "mesh as seen", "side", "front", "back")
MESHES = COLUMNS[2:]
"""Columns that show nothing of the dataset, for photographs that must not be passed on."""
SIDE, BACK = np.array(VIEWS["side"]).T, np.array(VIEWS["behind"]).T
FRONT = np.eye(3)
HALF_TURN = np.diag([-1.0, 1.0, -1.0])
"""Of a model whose head is at -z, so that "front" shows the head."""
HEADER, CAPTION, GAP = 16, 14, 10
"""Heights and a width, pixels."""
TALL = 8
"""More examples than these stand in two columns."""


@dataclass(frozen=True)
class Example:
    """One row of pictures.

    Attributes:
        name: of the photograph.
        iou: of mask and silhouette, ``None`` without a mask.
    """

    name: str
    iou: float | None


@dataclass(frozen=True)
class Report:
    """What the sheets need of an evaluation's folder.

    Attributes:
        folder: of the evaluation.
        examples: all photographs of the group, by name.
        flipped: whether the model's +z is the tail.
    """

    folder: Path
    examples: Sequence[Example]
    flipped: bool


def main() -> None:
    """Parse the command line and write the sheets."""
    parser = argparse.ArgumentParser(description="Contact sheets of the predictions of a fauna-eval report.")
    parser.add_argument("report", type=Path, metavar="REPORT", help="out folder of fauna-eval")
    parser.add_argument("--out", required=True, type=Path, help="folder for random.png, best.png and worst.png")
    parser.add_argument("--count", type=int, default=24, help="photographs chosen by lot (default 24)")
    parser.add_argument("--extremes", type=int, default=8, help="best and worst photographs by IoU (default 8 each)")
    parser.add_argument("--seed", type=int, default=0, help="of the lot (default 0)")
    parser.add_argument("--group", default="metrics", help="metrics or held_out (default metrics)")
    parser.add_argument(
        "--head", choices=("+z", "-z"), help="where the head is; default: where the report found it, else +z"
    )
    parser.add_argument("--meshes", action="store_true", help="leave out photographs and masks")
    given = parser.parse_args()
    with one_line_errors("python -m fauna.plots.gallery"):
        report = read_report(given.report, given.group)
        if given.head is not None:
            report = replace(report, flipped=given.head == "-z")
        for title, chosen in choose(report.examples, given.count, given.extremes, given.seed).items():
            save_png(sheet(report, chosen, MESHES if given.meshes else COLUMNS), given.out / f"{title}.png")
            print(f"{title}: {given.out / f'{title}.png'}")


def read_report(folder: Path, group: str) -> Report:
    """The photographs of a report and their scores.

    Args:
        folder: of an evaluation.
        group: ``metrics`` or ``held_out``.

    Raises:
        FaunaError: when it is no finished report, or has no such group.
    """
    try:
        images, report = (json.loads((folder / name).read_text("utf-8")) for name in ("images.json", "report.json"))
        flip: Mapping[str, Any] = report["metrics"].get("global_flip", {})
        rows = {name: of_group for name, of_group in images.items() if of_group}
        examples = [Example(name, row["scores"].get("iou")) for name, row in sorted(rows.get(group, {}).items())]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FaunaError(
            f"gallery: expected the folder of a fauna-eval report, got {folder} ({type(error).__name__}); check the path"
        ) from error
    if not examples:
        raise FaunaError(f"gallery: expected one of the groups {', '.join(rows)}, got --group {group}; choose one")
    return Report(folder, examples, bool(flip.get("value")))


def choose(examples: Sequence[Example], count: int, extremes: int, seed: int) -> dict[str, list[Example]]:
    """Examples by lot, without looking at their scores, in the order of their names; and the best and worst by IoU.

    Args:
        examples: in a fixed order.
        count: how many by lot.
        extremes: how many of the best, and of the worst.
        seed: of the lot.

    Raises:
        FaunaError: for numbers below 0.
    """
    if count < 0 or extremes < 0 or not count + extremes:
        raise FaunaError(
            f"gallery: expected numbers of photographs, got --count {count} --extremes {extremes}; raise them"
        )
    rng = np.random.default_rng(derive_seed(seed, "gallery"))
    places = sorted(rng.choice(len(examples), size=min(count, len(examples)), replace=False).tolist())
    scored = sorted(
        (each for each in examples if each.iou is not None), key=lambda each: (-(each.iou or 0.0), each.name)
    )
    extremes = min(extremes, len(scored))
    found = {"random": [examples[place] for place in places], "best": scored[:extremes]}
    found["worst"] = scored[len(scored) - extremes :][::-1]
    return {title: chosen for title, chosen in found.items() if chosen}


def sheet(report: Report, chosen: Sequence[Example], columns: Sequence[str] = COLUMNS) -> Image.Image:
    """One contact sheet, a row for each example.

    Args:
        report: of the examples.
        chosen: examples.
        columns: the last of :data:`COLUMNS`, all or :data:`MESHES`.

    Raises:
        FaunaError: when predictions are missing.
    """
    wanted = {each.name for each in chosen}
    samples, thumbnails = _samples(report.folder / "predictions" / SAMPLES, wanted)
    store = ArrayStore(report.folder / "predictions" / MODEL, identity=None)
    predictions = {item.name: unpack_prediction(item) for item in store.items() if item.name in wanted}
    missing = sorted(wanted - (predictions.keys() & samples.keys()))
    if missing:
        raise FaunaError(
            f"gallery: expected predictions of every photograph of the report, got none of {missing[0]}; evaluate anew"
        )
    strips = [
        _strip(samples[each.name], thumbnails[each.name], predictions[each.name], flipped=report.flipped)
        for each in chosen
    ]
    hidden = (len(COLUMNS) - len(columns)) * draw.CELL
    return _arrange([strip[:, hidden:] for strip in strips], [_caption(each) for each in chosen], columns)


def _samples(folder: Path, wanted: set[str]) -> tuple[dict[str, Sample], dict[str, bytes]]:
    samples, thumbnails = {}, {}
    for item in ArrayStore(folder, identity=None).items():
        if item.name in wanted:
            samples[item.name] = unpack_sample(item, ())
            thumbnails[item.name] = np.asarray(item.arrays["thumbnail"]).tobytes()
    return samples, thumbnails


def _strip(sample: Sample, thumbnail: bytes, prediction: Prediction, *, flipped: bool) -> np.ndarray:
    turn = HALF_TURN if flipped else np.eye(3)
    cells = [
        draw.photograph(thumbnail),
        draw.overlay(thumbnail, prediction) if sample.mask is None else draw.silhouettes(sample, prediction),
        draw.as_seen(prediction),
        *(draw.fixed_view(prediction, rotation @ turn) for rotation in (SIDE, FRONT, BACK)),
    ]
    return np.concatenate(cells, axis=1)


def _caption(example: Example) -> str:
    return example.name if example.iou is None else f"{example.name}   IoU {example.iou:.3f}"


def _arrange(strips: Sequence[np.ndarray], captions: Sequence[str], titles: Sequence[str]) -> Image.Image:
    """Strips below each other, in two columns when there are many, with captions and the columns' names."""
    columns = 2 if len(strips) > TALL else 1
    rows = -(-len(strips) // columns)
    width, height = strips[0].shape[1], draw.CELL + CAPTION
    page = Image.new("RGB", (columns * (width + GAP) - GAP, HEADER + rows * height), "white")
    pen = ImageDraw.Draw(page)
    for column in range(columns):
        for place, name in enumerate(titles):
            pen.text((column * (width + GAP) + place * draw.CELL + 3, 2), name, fill="black")
    for index, (strip, caption) in enumerate(zip(strips, captions, strict=True)):
        left, top = (index // rows) * (width + GAP), HEADER + (index % rows) * height
        pen.text((left + 3, top + 1), caption, fill=(90, 90, 90))
        page.paste(Image.fromarray(strip), (left, top + CAPTION))
    return page


if __name__ == "__main__":
    main()
