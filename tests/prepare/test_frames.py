"""Annotations of photographs that the camera noted as turned: boxes, keypoints and masks land on the same animal."""

import json

import numpy as np
import pytest
from PIL import Image

from fauna.prepare.frames import turned_box, turned_point
from fauna.reconstruct.pixels import ORIENTATION, oriented
from tests.prepare.piles import animal, flat, items, texture, through

STEPS = ("scan", "mask", "crop")
WORDS = ("mask.segmenter=none",)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_points_and_boxes_move_as_pixels_do(orientation):
    stored = np.zeros((30, 40), np.uint8)
    stored[5:9, 12:22] = 255
    upright = np.array(oriented(Image.fromarray(stored), orientation))
    size = upright.shape[::-1]
    left, top, right, bottom = turned_box((12.0, 5.0, 22.0, 9.0), size, orientation)
    expected = np.zeros_like(upright)
    expected[int(top) : int(bottom), int(left) : int(right)] = 255
    assert np.array_equal(upright, expected)
    x, y, _ = turned_point((12.5, 5.5, 1.0), size, orientation)  # the centre of the first pixel
    stored[:] = 0
    stored[5, 12] = 255
    upright = np.array(oriented(Image.fromarray(stored), orientation))
    assert upright[int(y), int(x)] == 255
    assert turned_point((0.0, 0.0, 0.0), size, orientation) == (0.0, 0.0, 0.0)


def photograph(folder, orientation):
    """A photograph whose stored pixels show the animal lying; the mask as it is stored."""
    mask = animal(30, 20)
    folder.mkdir(parents=True)
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    Image.fromarray(texture(mask)).save(folder / "a.jpg", quality=95, exif=exif)
    return mask


def expect(row, mask, orientation):
    upright = np.array(oriented(Image.fromarray(mask), orientation))
    rows, columns = np.nonzero(upright)
    box = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
    assert row.ok, row.reasons
    assert row.box == pytest.approx(box)
    assert row.keypoints is not None
    (x, y, _), last = row.keypoints
    first = np.zeros_like(mask)
    first[20, 30] = True  # the animal's first pixel
    assert np.array(oriented(Image.fromarray(first), orientation))[int(y), int(x)]
    assert last == (0.0, 0.0, 0.0)


def small_mask(folder, row):
    return np.array(Image.open(folder / "set.work/masks" / row.id[:2] / f"{row.id}.png"))


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("frame", ["stored", "stored, size not told", "upright"])
def test_items_turn_with_their_photograph(tmp_path, orientation, frame):
    mask = photograph(tmp_path / "in", orientation)
    drawn, (left, top) = mask, (30, 20)
    if frame == "upright":
        if orientation < 5:
            pytest.skip("its size does not tell this frame from the stored one")
        drawn = np.array(oriented(Image.fromarray(mask), orientation))
        first = np.zeros_like(mask)
        first[20, 30] = True
        top, left = (int(place[0]) for place in np.nonzero(np.array(oriented(Image.fromarray(first), orientation))))
    Image.fromarray(drawn).save(tmp_path / "in/m.png")
    rows, columns = np.nonzero(drawn)
    box = [int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1]
    entry = {
        "image": "a.jpg",
        "mask": "m.png",
        "category": "cow",
        "bbox_xyxy": box,
        "keypoints": [[left, top, 1], [0, 0, 0]],
    }
    size = {} if "not told" in frame else {"width": drawn.shape[1], "height": drawn.shape[0]}
    items(tmp_path / "in", [{**entry, **size}])
    (row,) = flat(through(tmp_path, *WORDS, steps=STEPS))
    expect(row, mask, orientation)
    assert np.array_equal(small_mask(tmp_path, row), np.array(oriented(Image.fromarray(mask), orientation)))


@pytest.mark.parametrize("orientation", [3, 6, 7])
@pytest.mark.parametrize("upright", [False, True])
def test_coco_outlines_turn_with_their_photograph(tmp_path, orientation, upright):
    mask = photograph(tmp_path / "in", orientation)
    if upright and orientation < 5:
        pytest.skip("its size does not tell this frame from the stored one")
    body = np.zeros_like(mask)
    body[20:50, 30:90] = True
    size, box = body.shape[::-1], (30.0, 20.0, 90.0, 50.0)
    point = (30.5, 20.5, 1.0)
    if upright:
        size = size[::-1]
        box, point = turned_box(box, size, orientation), turned_point(point, size, orientation)
    left, top, right, bottom = box
    ring = [left, top, right, top, right, bottom, left, bottom]
    known = {
        "id": 1,
        "image_id": 1,
        "category_id": 1,
        "segmentation": [ring],
        "bbox": [left, top, right - left, bottom - top],
    }
    content = {
        "images": [{"id": 1, "file_name": "a.jpg", "width": size[0], "height": size[1]}],
        "categories": [{"id": 1, "name": "cow", "keypoints": ["left_eye", "tailbase"]}],
        "annotations": [{**known, "keypoints": [point[0] - 0.5, point[1] - 0.5, 2, 0, 0, 0]}],
    }
    (tmp_path / "in/annotations.json").write_text(json.dumps(content))
    (row,) = flat(through(tmp_path, *WORDS, steps=STEPS))
    expect(row, body, orientation)
    assert np.array_equal(small_mask(tmp_path, row), np.array(oriented(Image.fromarray(body), orientation)))


def test_sizes_of_another_photograph_are_told(tmp_path):
    photograph(tmp_path / "in", 6)
    items(
        tmp_path / "in",
        [{"image": "a.jpg", "category": "cow", "bbox_xyxy": [1, 2, 50, 60], "width": 151, "height": 200}],
    )
    (row,) = flat(through(tmp_path, *WORDS, steps=("scan",)))
    assert row.reasons == ("scan:size_differs",)
