"""Which photographs are drawn for the report, and what is drawn where there is no mask."""

import base64
import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from fauna.evaluation.cases import COLUMNS, draw_cases
from fauna.evaluation.draw import CELL
from tests.evaluation.objects import animals, jpeg


def drawn(scores: dict[str, dict[str, float | None]], *, masks: bool):
    predictions, samples = animals()
    images = {s.name: {"species": s.category, "scores": scores.get(s.name, {"iou": None})} for s in samples}
    by_name = {s.name: s if masks else replace(s, mask=None) for s in samples}
    thumbnails = {s.name: jpeg() for s in samples}
    return draw_cases(images, by_name, thumbnails, {p.name: p for p in predictions}, species=1)


def cells(case) -> dict[str, np.ndarray]:
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(case.png))).convert("RGB"))
    return {name: picture[:, place * CELL : (place + 1) * CELL] for place, name in enumerate(COLUMNS)}


def test_best_median_and_worst_by_silhouette():
    cases = drawn({"long/0": {"iou": 0.2}, "long/1": {"iou": 0.9}, "long/2": {"iou": 0.5}}, masks=True)
    assert [(case.rank, case.name, case.key) for case in cases] == [
        ("best", "long/1", "iou"),
        ("median", "long/2", "iou"),
        ("worst", "long/0", "iou"),
    ]


@pytest.mark.parametrize(
    ("scores", "ranks"),
    [
        ({f"long/{i}": {"iou": None, "kt_pck@0.1": 0.1 * i} for i in range(3)}, ["best", "median", "worst"]),
        ({}, ["unranked"] * 3),
    ],
)
def test_without_masks_photograph_and_overlay_are_shown(scores, ranks):
    cases = drawn(scores, masks=False)
    assert [case.rank for case in cases] == ranks
    for case in cases:
        shown = cells(case)
        assert shown["silhouettes"].min() == 255  # nothing to compare with
        assert shown["photograph"].std(axis=(0, 1)).max() < 3  # the grey picture
        assert np.abs(shown["mesh"].astype(int) - shown["photograph"]).max() > 40  # the mesh on it
    if scores:
        assert cases[0].score == pytest.approx(0.2)
