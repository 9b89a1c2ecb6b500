import json

import numpy as np
import pytest
from PIL import Image

from fauna.data.readers.masks import Polygons, encode_mask
from fauna.masks.base import Segmenter
from fauna.prepare.mask import mask_box
from fauna.prepare.masks_given import text_of_mask
from fauna.prepare.masks_stored import read_mask
from tests.prepare.piles import HEIGHT, WIDTH, animal, flat, items, opened, put, texture, through

STEPS = ("scan", "mask")
NO = "mask.segmenter=none"


class Fixed(Segmenter):
    """Finds what it was told."""

    name = "fixed"
    flags = ("mask_from_saliency",)

    def __init__(self, mask):
        self.mask = mask
        self.seen = []

    def segment(self, image):
        self.seen.append(image.shape[:2])
        return self.mask[: image.shape[0], : image.shape[1]]


def masks_of(folder, rows):
    _, workspace = opened(folder)
    return [read_mask(workspace.mask(row.id)) for row in rows if row.ok]


def test_a_mask_of_two_animals_gives_two_rows(tmp_path):
    large, small = animal(10, 20, size=80), animal(130, 60, size=50)
    put(tmp_path / "in/horse", "a", large | small)
    rows = flat(through(tmp_path, NO, steps=STEPS))
    assert [row.instance for row in rows] == [0, 1]
    assert rows[1].id == f"{rows[0].photo}_01"
    found = masks_of(tmp_path, rows)
    assert (found[0] == large).all()
    assert (found[1] == small).all()
    assert [row.box for row in rows] == [mask_box(large, 1.0), mask_box(small, 1.0)]
    assert rows[0].mask_source == "given"
    assert "several_animals" in rows[0].notes


def test_more_animals_than_the_limit_are_named(tmp_path):
    mask = animal(5, 5, size=50) | animal(75, 5, size=48) | animal(140, 5, size=46)
    put(tmp_path / "in/horse", "a", mask)
    rows = flat(through(tmp_path, NO, "mask.max_animals=2", steps=STEPS))
    assert [row.reasons for row in rows] == [(), (), ("mask:more_animals",)]


def test_an_annotated_animal_stays_one_however_many_parts_it_has(tmp_path):
    mask = animal(10, 20) | animal(130, 60)
    path = put(tmp_path / "in/images", "a", mask, beside=False)
    Image.fromarray(mask).save(tmp_path / "in/m.png")
    items(tmp_path / "in", [{"image": f"images/{path.name}", "mask": "m.png", "category": "cow"}])
    (row,) = flat(through(tmp_path, NO, steps=STEPS))
    assert (masks_of(tmp_path, [row])[0] == mask).all()


def test_labels_of_a_video_are_one_animal_each(tmp_path):
    mask = animal(10, 20, size=80)
    mask[:, 45:60] = False  # a post
    Image.fromarray(texture(mask)).save(put(tmp_path / "in/JPEGImages/goat", "00000", mask, beside=False))
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    labels[mask] = 1
    labels[animal(130, 60, size=50)] = 2
    picture = Image.fromarray(labels, "P")
    picture.putpalette([0, 0, 0, 200, 0, 0, 0, 200, 0])
    (tmp_path / "in/Annotations/goat").mkdir(parents=True)
    picture.save(tmp_path / "in/Annotations/goat/00000.png")
    rows = flat(through(tmp_path, NO, steps=STEPS))
    assert len(rows) == 2
    assert (masks_of(tmp_path, rows)[0] == mask).all()


@pytest.mark.parametrize(
    "segmentation",
    [
        [[float("nan"), 30, 100, 30, 100, 90]],
        [[float("inf"), 30, 100, 30, 100, 90]],
        {"size": [10**9, 10**9], "counts": [0, 10**18]},
        {"size": [HEIGHT, WIDTH], "counts": "\x01"},
        {"size": [HEIGHT, WIDTH], "counts": [1, 2, 3]},
    ],
)
def test_masks_of_annotation_files_that_are_none_are_told(tmp_path, segmentation):
    put(tmp_path / "in", "a", animal(40, 30), beside=False)
    content = {
        "images": [{"id": 1, "file_name": "a.png", "width": WIDTH, "height": HEIGHT}],
        "categories": [{"id": 1, "name": "cow"}],
        "annotations": [{"id": 1, "image_id": 1, "category_id": 1, "segmentation": segmentation}],
    }
    (tmp_path / "in/annotations.json").write_text(json.dumps(content))
    (row,) = flat(through(tmp_path, steps=("scan", "mask")))
    assert row.reasons[0] in ("mask:bad_mask", "mask:no_animal")


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
@pytest.mark.parametrize("kind", ["rle", "polygons"])
def test_masks_of_annotation_files_turn_with_the_photograph(tmp_path, orientation, kind):
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[20:70, 30:110] = True
    exif = Image.Exif()
    exif[0x0112] = orientation
    (tmp_path / "in").mkdir()
    Image.fromarray(texture(mask)).save(tmp_path / "in/a.png", exif=exif)
    given = encode_mask(mask) if kind == "rle" else Polygons(((30.0, 20.0, 110.0, 20.0, 110.0, 70.0, 30.0, 70.0),))
    text = text_of_mask(given)
    assert json.loads(text.partition(":")[2])
    segmentation = json.loads(text.partition(":")[2])
    annotation = {"id": 1, "image_id": 1, "category_id": 1, "segmentation": segmentation, "bbox": [30, 20, 80, 50]}
    content = {
        "images": [{"id": 1, "file_name": "a.png"}],
        "annotations": [annotation],
        "categories": [{"id": 1, "name": "fox"}],
    }
    (tmp_path / "in/all.json").write_text(json.dumps(content))
    (row,) = flat(through(tmp_path, NO, steps=STEPS))
    turned = {1: mask, 3: np.rot90(mask, 2), 6: np.rot90(mask, 3), 8: np.rot90(mask)}[orientation]
    assert (masks_of(tmp_path, [row])[0] == turned).all()


def test_alpha_is_a_mask_and_nothing_is_a_reason(tmp_path):
    mask = animal(40, 30)
    (tmp_path / "in/fox").mkdir(parents=True)
    opaque = mask.astype(np.uint8) * np.uint8(255)
    Image.fromarray(np.dstack([texture(mask), opaque])).save(tmp_path / "in/fox/a.png")
    Image.fromarray(texture(mask)).save(tmp_path / "in/fox/b.png")
    first, second = flat(through(tmp_path, NO, steps=STEPS))
    assert first.mask_source == "alpha"
    assert (masks_of(tmp_path, [first])[0] == mask).all()
    assert second.reasons == ("mask:no_mask",)


def test_masks_of_another_picture_are_refused(tmp_path):
    put(tmp_path / "in/fox", "a", animal(40, 30))
    Image.new("L", (90, 90), 255).save(tmp_path / "in/fox/a_mask.png")
    put(tmp_path / "in/fox", "b", animal(40, 30))
    (tmp_path / "in/fox/b_mask.png").write_bytes(b"no picture")
    put(tmp_path / "in/fox", "c", np.zeros((HEIGHT, WIDTH), bool))
    rows = flat(through(tmp_path, NO, steps=STEPS))
    assert [row.reasons for row in rows] == [("mask:bad_mask",), ("mask:bad_mask",), ("mask:no_animal",)]


def test_the_segmenter_is_shown_annotated_boxes(tmp_path):
    mask = animal(40, 30)
    path = put(tmp_path / "in/images", "a", mask, beside=False)
    box = [40, 30, 100, 90]
    items(
        tmp_path / "in",
        [{"image": f"images/{path.name}", "category": "cow", "bbox_xyxy": box, "keypoints": [[41, 31, 1], [0, 0, 0]]}],
    )
    everything = Fixed(np.ones((HEIGHT, WIDTH), bool))
    (row,) = flat(through(tmp_path, steps=STEPS, segmenter=everything))
    assert row.ok
    assert {"mask_from_box", "mask_from_saliency"} <= set(row.notes)
    (found,) = masks_of(tmp_path, [row])
    assert found[27:93, 37:103].all()  # the box and box_margin
    assert found.sum() <= 70 * 70
    assert everything.seen[0][0] < HEIGHT
    speck = np.zeros((HEIGHT, WIDTH), bool)
    speck[20:40, 20:40] = True
    (row,) = flat(through(tmp_path, steps=STEPS, segmenter=Fixed(speck)))
    assert row.reasons == ("mask:off_box",)


def test_keys_follow_settings_and_stamps_follow_mask_files(tmp_path):
    from fauna.prepare.mask import MaskStep

    put(tmp_path / "in/fox", "a", animal(40, 30))
    (rows,) = through(tmp_path, NO, steps=("scan",))
    steps = [
        MaskStep(settings=s, workspace=w) for s, w in (opened(tmp_path, NO), opened(tmp_path, NO, "mask.max_animals=3"))
    ]
    assert steps[0].key != steps[1].key
    before = steps[0].stamp(rows)
    (tmp_path / "in/fox/a_mask.png").write_bytes(b"another")
    assert steps[0].stamp(rows) != before
