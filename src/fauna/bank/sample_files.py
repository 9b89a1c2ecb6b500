"""The files of a bank's samples. ``result.json`` comes last: where it is, everything else is."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from fauna.bank.samples import BankSample, BankSamples
from fauna.errors import FaunaError
from fauna.export import write_glb
from fauna.io.contact_sheet import save_png
from fauna.io.run_folder import write_json
from fauna.plots.bodies import Look, body_views, sheet, stacked, tile
from fauna.reconstruct.report import versions
from fauna.reconstruct.traits import Body, embody, resting, rigged
from fauna.viewer.studio import CLAY

SCHEMA = "fauna-bank-1"
SHEET, RESULT = "bank.png", "result.json"
CELL, VIEWS, COLUMNS = 104, 3, 5
"""Side of a picture, pixels; pictures of a body; bodies in a row."""
TITLES = {"slot": "every slot alone", "ten": "random mixtures of ten slots", "all": "random mixtures of all slots"}


def write_samples(samples: BankSamples, folder: Path, **extra: object) -> bool:
    """Write everything into an existing folder.

    Args:
        samples: of a bank.
        folder: where to.
        extra: further keys of ``result.json``.

    Returns:
        Whether every sample became an animal.
    """
    rows: list[dict[str, Any]] = []
    tiles: dict[str, list[Image.Image]] = {}
    for sample in samples.samples:
        facts, body = _written(samples, sample, folder)
        rows.append(facts)
        if body is not None:
            look = Look(body.base.verts, body.base.faces)
            views = body_views(look, views=VIEWS, size=CELL)
            tiles.setdefault(sample.kind, []).append(tile(views, sample.name.replace("_", " ")))
    sheets = [(TITLES[kind], sheet(each, columns=COLUMNS)) for kind, each in tiles.items()]
    files = [each["file"] for each in rows if each["file"] is not None]
    if sheets:
        save_png(stacked(sheets), folder / SHEET)
        files.append(SHEET)
    whole = all(each["status"] == "ok" for each in rows)
    content: Mapping[str, Any] = {
        "schema": SCHEMA,
        "status": "ok" if whole else "failed",
        "weights": samples.weights_sha256,
        "seed": samples.seed,
        "samples": rows,
        "files": [*files, RESULT],
        "versions": versions(),
    }
    write_json({**content, **extra}, folder / RESULT)
    return whole


def sample_sheet(samples: Sequence[tuple[str, Look]]) -> Image.Image:
    """Bodies with captions, :data:`COLUMNS` in a row, each from :data:`VIEWS` sides."""
    return sheet([tile(body_views(look, views=VIEWS, size=CELL), name) for name, look in samples], columns=COLUMNS)


def _written(samples: BankSamples, sample: BankSample, folder: Path) -> tuple[dict[str, Any], Body | None]:
    """A sample's entry in ``result.json`` and its body; its GLB lies in the folder where that could be made."""
    weights = [round(each, 6) for each in sample.weights]
    entry: dict[str, Any] = {"name": sample.name, "slots": list(sample.slots), "weights": weights}
    body: Body | None = None
    try:
        body = embody(samples.model, resting(sample.code))
        colours = np.broadcast_to(np.array(CLAY), (len(body.base.verts), 3))
        animal = rigged(samples.model, body, name=sample.name, colours=colours)
        write_glb(animal, folder / f"{sample.name}.glb")
    except FaunaError as error:
        return {**entry, "status": "failed", "reason": str(error), "file": None, "vertices": 0}, body
    facts = {"status": "ok", "reason": "", "file": f"{sample.name}.glb", "vertices": len(animal.vertices)}
    return {**entry, **facts}, body
