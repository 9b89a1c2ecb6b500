"""The calibration of confidence runs, its rows say what they are said to say, and the shipped numbers are those of the shipped weights."""

import importlib
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fauna.evaluation.weights import file_digest
from fauna.pretrained.shipped import shipped_weights
from fauna.reconstruct.quality import Measures
from fauna.reconstruct.settings import default_settings

FOLDER = Path(__file__).parents[2] / "benchmarks"
FIELDS = {
    *("set", "kind", "pictures", "iou_median", "strangeness_median", "distinctness_median", "confidence_median"),
    *("doubted", "doubted_held_out", "wrong_held_out", "fit"),
}


@pytest.fixture
def benchmark(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module("confidence")


def test_shipped_confidence_was_fitted_to_the_shipped_weights():
    """New weights need new numbers: run benchmarks/confidence.py and put its last line into conf/reconstruct.yaml."""
    assert default_settings().quality.weights == file_digest(shipped_weights())


def test_smoke_run(benchmark, tmp_path):
    rng = np.random.default_rng(0)
    (tmp_path / "photos" / "masks").mkdir(parents=True)
    mask = np.zeros((120, 200), np.uint8)
    mask[40:80, 20:60] = 255
    for name in ("a", "b"):
        Image.fromarray(rng.integers(0, 255, (120, 200, 3), dtype=np.uint8)).save(tmp_path / "photos" / f"{name}.png")
        Image.fromarray(mask).save(tmp_path / "photos" / "masks" / f"{name}.png")
    arguments = ["--smoke", "--animals", str(tmp_path / "photos"), "--json", str(tmp_path / "rows.json")]
    printed = benchmark.main(arguments)
    rows = {row["set"]: row for row in json.loads((tmp_path / "rows.json").read_text())}
    assert list(rows.values()) == printed
    assert all(set(row) == FIELDS for row in printed)
    assert {row["kind"] for row in printed} == set(benchmark.KINDS)
    assert rows["drawn animals"]["pictures"] == 12
    assert rows["beside photos"]["pictures"] == 2
    # the shipped numbers tell drawn animals from drawn things
    assert rows["drawn animals"]["confidence_median"] > 0.9 > 0.1 > rows["drawn things"]["confidence_median"]
    assert rows["drawn animals"]["doubted"] == 0.0
    assert rows["drawn things"]["doubted"] > 0.8
    assert set(rows["photos"]["fit"]) == {"bias", "iou", "strangeness", "distinctness", "weights"}
    assert rows["photos"]["fit"]["weights"] == default_settings().quality.weights


def test_the_fit_finds_the_numbers_that_made_the_labels(benchmark):
    rng = np.random.default_rng(0)
    truth = np.array([-1.0, 4.0, -5.0, 3.0])
    table = rng.normal((0.7, 1.5, 1.3), (0.4, 0.5, 0.4), (20_000, 3))
    animals = rng.random(len(table)) < 1 / (1 + np.exp(-(truth[0] + table @ truth[1:])))
    sets = []
    for kind, chosen in (("animals", animals), ("things", ~animals)):
        measures = tuple(Measures(iou, 0.0, None, strange, distinct) for iou, strange, distinct in table[chosen])
        sets.append(benchmark.PictureSet(kind, kind, measures, tuple(range(len(measures)))))
    found = benchmark.fitted(sets, np.ones(len(table), bool))
    directions = [each[1:] / np.linalg.norm(each[1:]) for each in (found, truth)]
    np.testing.assert_allclose(*directions, atol=0.05)  # the ridge shortens, classes that weigh the same shift the bias


def test_pieces_hold_no_animal(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    things = importlib.import_module("things")
    mask = np.zeros((200, 300), bool)
    mask[50:150, 100:160] = True
    image = np.where(mask[..., None], 255, 0).astype(np.uint8).repeat(3, axis=2)
    ((piece, outline),) = things.pieces(iter([(image, mask)]), 0)
    assert piece.max() == 0
    assert piece.shape[:2] == outline.shape == (things.SIDE, things.SIDE)
    assert not list(things.pieces(iter([(image[:60, :60], mask[:60, :60])]), 0))
    kinds = [things.outline(number, np.random.default_rng(0)) for number in range(len(things.THINGS) + 1)]
    assert all(0.01 < each.mean() < 0.9 for each in kinds)
