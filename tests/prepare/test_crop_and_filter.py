import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from fauna.data.crop_box import read_box
from fauna.data.cut import mask_window
from fauna.prepare.filter import FilterStep, objections
from fauna.prepare.measures import Measures, in_parts, measure, sharpness, truncation
from fauna.prepare.reasons import REASONS
from fauna.prepare.settings import prepare_settings
from fauna.prepare.sheets import write_sheets
from fauna.prepare.tables import write_table
from tests.prepare.piles import HEIGHT, WIDTH, animal, flat, items, opened, put, texture, through, with_override

NO = "mask.segmenter=none"
GOOD = Measures(extent=200.0, sharpness=400.0, fill=0.25, truncation=0.0, occlusion=0.0, parts=1)


def test_crops_follow_the_shared_rule_with_a_box_in_photograph_pixels(tmp_path):
    mask = animal(60, 40)
    put(tmp_path / "in/horse", "a", mask)
    (row,) = flat(through(tmp_path, NO))
    _, workspace = opened(tmp_path)
    assert row.window == tuple(float(value) for value in mask_window(mask))
    box = read_box(workspace.crop(row.id, "box.txt"))
    assert (box.x0, box.y0, box.width, box.height) == (*row.window, row.window[2])
    assert (box.photo_width, box.photo_height) == (WIDTH, HEIGHT)
    small = np.array(Image.open(workspace.crop(row.id, "mask.png")))
    assert set(np.unique(small)) == {0, 255}
    assert small.shape == (256, 256)
    assert row.fill == pytest.approx((small > 127).mean(), abs=1e-6)


def test_places_are_those_of_the_photograph_at_full_size(tmp_path):
    mask = animal(60, 40)
    put(tmp_path / "in/horse", "a", mask)
    (full,) = flat(through(tmp_path, NO))
    (half,) = flat(through(tmp_path, NO, "photo.work_side=100"))
    assert full.window is not None
    assert half.window is not None
    assert np.allclose(full.window, half.window, atol=3.0)
    assert full.box is not None
    assert half.box is not None
    assert np.allclose(full.box, half.box, atol=2.0)


def test_keypoints_lie_where_they_lay(tmp_path):
    mask = animal(60, 40)
    path = put(tmp_path / "in/images", "a", mask, beside=False)
    pixels = np.array(Image.open(path))
    pixels[...] = 0
    pixels[50:54, 80:84] = 255
    Image.fromarray(pixels).save(path)
    Image.fromarray(mask).save(tmp_path / "in/m.png")
    points = [[81, 51, 1], [5, 5, 0]]
    items(tmp_path / "in", [{"image": f"images/{path.name}", "mask": "m.png", "category": "cow", "keypoints": points}])
    (row,) = flat(through(tmp_path, NO))
    _, workspace = opened(tmp_path)
    (x, y, flag), unknown = json.loads(workspace.crop(row.id, "keypoints.json").read_text())["keypoints"]
    crop = np.array(Image.open(workspace.crop(row.id, "rgb.jpg")).convert("L"))
    rows, columns = np.nonzero(crop > 127)
    assert flag == 1.0
    assert abs(x - columns.mean()) < 4
    assert abs(y - rows.mean()) < 4
    assert unknown == [0.0, 0.0, 0.0]


def test_sharpness_falls_with_blur_and_looks_at_the_animal_only():
    mask = animal(60, 40)[:HEIGHT, :HEIGHT]
    sharp = texture(animal(60, 40))[:, :HEIGHT]
    from PIL import ImageFilter

    blurred = np.array(Image.fromarray(sharp).filter(ImageFilter.GaussianBlur(3)))
    elsewhere = np.where(mask[..., None], blurred, sharp)
    assert sharpness(sharp, mask) > 50 * sharpness(blurred, mask)
    assert sharpness(elsewhere, mask) < 2 * sharpness(blurred, mask)
    assert sharpness(np.full((8, 8, 3), 9, np.uint8), np.ones((8, 8), bool)) == 0.0


def test_truncation_counts_masks_that_end_just_before_the_border():
    mask = np.zeros((100, 100), bool)
    mask[40:60, 3:43] = True
    assert truncation(mask, 0) == 0.0
    assert truncation(mask, 4) == pytest.approx(20 / (2 * (20 + 39)))
    assert truncation(np.zeros((9, 9), bool), 2) == 0.0


def test_measures_of_a_mask_in_two_parts():
    mask = np.zeros((60, 80), bool)
    mask[10:40, 10:30] = True
    mask[10:40, 40:50] = True
    mask[50, 70] = True  # a speck
    found = measure(texture(animal(0, 0))[:60, :60], mask[:60, :60], mask, scale=2.0, speck_share=0.01, border=0.0)
    assert found.parts == 2
    assert found.occlusion == pytest.approx(1 - 600 / 901)
    assert found.extent == 2.0 * 61
    assert in_parts(mask, 0.0)[1] == 3


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"extent": 31.0}, "small_animal"), ({"sharpness": 5.0}, "blurred"), ({"truncation": 0.3}, "truncated"),
        ({"occlusion": 0.5}, "occluded"), ({"parts": 9}, "occluded"), ({"fill": 0.01}, "low_fill"), ({"fill": 0.95}, "high_fill"),
    ],
)  # fmt: skip
def test_every_objection_has_its_own_word(change, word):
    limits = prepare_settings([]).filter
    assert list(objections(GOOD, limits)) == []
    assert list(objections(replace(GOOD, **change), limits)) == [word]
    assert word in REASONS
    names = ("min_extent", "min_sharpness", "max_truncation", "max_occlusion", "max_parts", "min_fill", "max_fill")
    off = prepare_settings([f"filter.{name}=null" for name in names]).filter
    assert list(objections(replace(GOOD, **change), off)) == []


def test_overrides_beat_the_filter_either_way(tmp_path):
    put(tmp_path / "in/horse", "a", animal(60, 40))
    strict = (NO, "filter.min_sharpness=1e9")
    rows = through(tmp_path, *strict, steps=("scan", "mask", "crop"))[0]
    step = FilterStep(settings=opened(tmp_path, *strict)[0], workspace=opened(tmp_path)[1])
    (rejected,) = step(rows)
    (kept,) = step((with_override(rows[0], "keep"),))
    assert (rejected.status, rejected.reasons) == ("rejected", ("filter:blurred",))
    assert (kept.status, kept.reasons) == ("ok", ("filter:blurred",))
    lenient = FilterStep(settings=opened(tmp_path, NO)[0], workspace=opened(tmp_path)[1])
    (dropped,) = lenient((with_override(rows[0], "drop"),))
    assert (dropped.status, dropped.reasons) == ("rejected", ("filter:dropped",))


def test_sheets_show_each_reason_and_do_not_depend_on_tables(tmp_path):
    put(tmp_path / "in/horse", "good", animal(60, 40))
    put(tmp_path / "in/horse", "cut", animal(-0, 40, size=100))
    put(tmp_path / "in/horse", "tiny", animal(60, 40, size=20))
    (tmp_path / "in/horse/broken.png").write_bytes(b"no picture")
    rows = sorted(flat(through(tmp_path, NO, "filter.max_truncation=0.05")), key=lambda row: row.id)
    settings, workspace = opened(tmp_path, NO)
    whole = [tmp_path / "one.parquet"]
    parts = [tmp_path / "a.parquet", tmp_path / "b.parquet"]
    write_table(whole[0], rows)
    write_table(parts[0], rows[2:])
    write_table(parts[1], rows[:2])
    first = {path.name: path.read_bytes() for path in write_sheets(whole, settings, workspace)}
    again = {path.name: path.read_bytes() for path in write_sheets(parts, settings, workspace)}
    assert first == again
    words = ("scan-unreadable", "filter-small_animal", "filter-blurred", "filter-truncated", "used")
    assert set(first) == {f"{word}.png" for word in words}
    write_table(whole[0], [row for row in rows if row.ok])
    assert [path.name for path in write_sheets(whole, settings, workspace)] == ["used.png"]
    assert list((workspace.report / "rejected").iterdir()) == []
