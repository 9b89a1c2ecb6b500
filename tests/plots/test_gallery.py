"""Contact sheets of stored predictions: who is chosen, what is drawn where."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from fauna.errors import FaunaError
from fauna.evaluation.draw import CELL
from fauna.evaluation.report import write_reports
from fauna.evaluation.scoring import ScoreOptions
from fauna.plots import gallery
from fauna.plots.gallery import CAPTION, COLUMNS, HEADER, MESHES, Example, choose, read_report, sheet
from tests.evaluation.objects import write_predictions

EXAMPLES = [Example(f"{place:02d}", None if place == 5 else ((7 * place) % 20) / 20) for place in range(20)]


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    predictions = write_predictions(folder / "predictions", grow=1, held_out=True)
    write_reports(predictions, folder, ScoreOptions(seed=0, pairs=10, bootstrap=5, settings=()), pictures=1)
    return folder


def test_the_lot_does_not_look_at_scores():
    names = [each.name for each in choose(EXAMPLES, 6, 0, seed=3)["random"]]
    blind = [Example(each.name, None) for each in EXAMPLES]
    assert names == [each.name for each in choose(blind, 6, 0, seed=3)["random"]]
    assert names == sorted(set(names))
    assert names != [each.name for each in choose(EXAMPLES, 6, 0, seed=4)["random"]]
    everyone = {each.name for seed in range(40) for each in choose(EXAMPLES, 6, 0, seed=seed)["random"]}
    assert everyone == {each.name for each in EXAMPLES}


def test_best_and_worst_are_those_by_iou():
    found = choose(EXAMPLES, 100, 4, seed=0)
    ranked = sorted((each.iou for each in EXAMPLES if each.iou is not None), reverse=True)
    assert [each.iou for each in found["best"]] == ranked[:4]
    assert [each.iou for each in found["worst"]] == ranked[::-1][:4]
    assert found["random"] == EXAMPLES


@pytest.mark.parametrize("numbers", [(-1, 3), (3, -1), (0, 0)])
def test_numbers_without_photographs_are_refused(numbers):
    with pytest.raises(FaunaError, match="^gallery: expected numbers"):
        choose(EXAMPLES, *numbers, seed=0)


def cells(picture: Image.Image, row: int) -> dict[str, np.ndarray]:
    top = HEADER + row * (CELL + CAPTION) + CAPTION
    strip = np.asarray(picture)[top : top + CELL]
    return {name: strip[:, place * CELL : (place + 1) * CELL] for place, name in enumerate(COLUMNS)}


def width_of(cell: np.ndarray) -> int:
    """Of what is not white, pixels."""
    return int((cell.min(axis=2) < 250).any(axis=0).sum())


def test_the_sheet_shows_each_from_all_sides(report):
    """The long box (2.4 x 1.2 x 1.0) is seen by its own front camera, so that front and back are wide and the side is narrow."""
    read = read_report(report, "metrics")
    assert [each.name for each in read.examples] == ["long/0", "long/1", "long/2"]
    picture = sheet(read, read.examples[:2])
    assert picture.size == (len(COLUMNS) * CELL, HEADER + 2 * (CELL + CAPTION))
    shown = cells(picture, 0)
    assert width_of(shown["front"]) == width_of(shown["back"]) > 1.8 * width_of(shown["side"]) > 0
    assert np.ptp(shown["photograph"].reshape(-1, 3), axis=0).max() < 8  # the grey thumbnail
    assert width_of(shown["mask and silhouette"]) > 0


def test_head_at_the_other_end_turns_front_and_back(report, monkeypatch):
    """The mesh cut off at z < 0: from the front and from the back something else is seen, and the turn swaps the two."""
    read = read_report(report, "metrics")
    original = gallery.unpack_prediction

    def half(item):
        prediction = original(item)
        verts = prediction.verts.copy()
        verts[verts[:, 2] < 0, 0] *= 0.3  # the rear is narrow
        return replace(prediction, verts=verts)

    monkeypatch.setattr(gallery, "unpack_prediction", half)
    plain, turned = (cells(sheet(replace(read, flipped=flip), read.examples[:1]), 0) for flip in (False, True))
    assert not np.array_equal(plain["front"], plain["back"])
    assert np.array_equal(plain["front"], turned["back"])
    assert np.array_equal(plain["back"], turned["front"])
    assert np.array_equal(plain["mesh as seen"], turned["mesh as seen"])


def test_photographs_can_be_left_out(report):
    read = read_report(report, "metrics")
    whole, meshes = (
        np.asarray(sheet(read, read.examples[:1], columns))[HEADER + CAPTION :] for columns in (COLUMNS, MESHES)
    )
    assert meshes.shape[1] == len(MESHES) * CELL
    assert np.array_equal(meshes, whole[:, 2 * CELL :])


def test_many_stand_in_two_columns(report):
    read = read_report(report, "metrics")
    assert sheet(read, list(read.examples) * 4).size[1] == HEADER + 6 * (CELL + CAPTION)


def test_command(report, tmp_path, monkeypatch, capsys):
    def run(*words: object) -> None:
        monkeypatch.setattr(sys, "argv", ["gallery", *map(str, words)])
        gallery.main()

    run(report, "--out", tmp_path, "--group", "held_out", "--count", 2, "--extremes", 1, "--head=-z")
    assert {path.name for path in tmp_path.iterdir()} == {"random.png", "best.png", "worst.png"}
    capsys.readouterr()
    for words in ((tmp_path, "--out", tmp_path), (report, "--out", tmp_path, "--group", "nobody")):
        with pytest.raises(SystemExit) as stopped:
            run(*words)
        assert stopped.value.code == 2
        assert capsys.readouterr().err.startswith("fauna: error: gallery: expected")


def test_reports_without_their_predictions_are_refused(report, tmp_path):
    for name in ("report.json", "images.json"):
        (tmp_path / name).write_bytes((report / name).read_bytes())
    read = read_report(tmp_path, "metrics")
    with pytest.raises(FaunaError, match="^predictions: expected a folder with index.json"):
        sheet(read, read.examples)
    with pytest.raises(FaunaError, match="got none of long/9"):
        sheet(replace(read, folder=report), [Example("long/9", 0.5)])
