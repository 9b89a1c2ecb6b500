"""Crops are cut where the shared rule says, and keypoints move with the pixels."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from fauna.data.crop_window import crop_window
from fauna.data.readers.crop import CropSource, clip_box, widen_box
from fauna.data.readers.masks import MaskFile, encode_mask
from fauna.errors import FaunaError
from tests.data.readers.fixtures import ANIMALS, HEIGHT, WIDTH, ellipse, photograph


@pytest.fixture
def image(tmp_path):
    path = tmp_path / "photo.png"
    photograph(path, marks=[(12, 15), (40, 30)])
    return path


def source(image, **changes) -> CropSource:
    given = {
        "image": image, "origin": "set/file.json/1", "size": (WIDTH, HEIGHT), "box": tuple(map(float, ANIMALS[0])),
        "mask": encode_mask(ellipse(ANIMALS[0])), "keypoints": ((12.5, 15.5, 1.0), (0.0, 0.0, 0.0)),
        "crop_size": 128, "box_fill": 0.5,
    }  # fmt: skip
    return CropSource(**{**given, **changes})


def expected_window(mask: np.ndarray) -> tuple[int, int, int]:
    """Slowly, pixel by pixel."""
    places = [(x + 0.5, y + 0.5) for y in range(HEIGHT) for x in range(WIDTH) if mask[y, x]]
    xs, ys = zip(*places, strict=True)
    bounds = (min(xs) - 0.5, min(ys) - 0.5, max(xs) + 0.5, max(ys) + 0.5)
    return crop_window(float(len(places)), (sum(xs) / len(xs), sum(ys) / len(ys)), bounds)


def test_window_follows_the_mask_and_pixels_outside_are_black(image):
    mask = ellipse(ANIMALS[1])
    raw = source(image, mask=encode_mask(mask)).read()
    left, top, side = expected_window(mask)
    assert (raw.box.x0, raw.box.y0, raw.box.width, raw.box.height) == (left, top, side, side)
    assert (raw.box.photo_width, raw.box.photo_height) == (WIDTH, HEIGHT)
    assert left + side > WIDTH + 1
    centres = (np.arange(128) + 0.5) * side / 128
    for row in range(4, 128, 9):
        for column in range(4, 128, 9):
            x, y = int(left + centres[column]), int(top + centres[row])
            assert raw.mask[row, column] == (x < WIDTH and y < HEIGHT and bool(mask[y, x]))
    assert not raw.image[:, left + centres > WIDTH + 1].any()
    assert not raw.image[top + centres > HEIGHT + 1].any()
    assert (raw.image[top + centres < HEIGHT - 1][:, left + centres < WIDTH - 1].max(-1) > 100).all()


def test_a_keypoint_lies_on_its_pixel(image):
    raw = source(image, crop_size=256).read()
    x, y, flag = raw.keypoints[0]
    assert flag == 1
    assert (raw.image[int(y), int(x)] > 240).all()  # the white mark at (12, 15)
    rows, columns = np.nonzero((raw.image > 200).all(-1) & (np.abs(np.arange(256) - x) < 30)[None])
    assert abs(columns.mean() + 0.5 - x) < 0.6
    assert abs(rows.mean() + 0.5 - y) < 0.6
    assert raw.keypoints[1].tolist() == [0, 0, 0]


def test_keypoints_come_back_to_the_photograph(image):
    points = ((3.25, 38.0, 1.0), (59.0, 1.0, 1.0))  # also outside the crop
    raw = source(image, keypoints=points, crop_size=57).read()
    back = raw.keypoints[:, :2] * raw.box.width / 57 + [raw.box.x0, raw.box.y0]
    np.testing.assert_allclose(back, np.array(points)[:, :2], atol=1e-12)
    assert source(image, keypoints=None).read().keypoints is None


def test_without_a_mask_the_box_places_the_crop(image):
    boxed = source(image, mask=None)
    raw = boxed.read()
    left, top, right, bottom = ANIMALS[0]
    area = 0.5 * (right - left) * (bottom - top)
    expected = crop_window(area, ((left + right) / 2, (top + bottom) / 2), tuple(map(float, ANIMALS[0])))
    assert (raw.box.x0, raw.box.y0, raw.box.width) == expected
    assert raw.mask_source == boxed.mask_source == "box"
    assert source(image).read().mask_source == source(image).mask_source == "annotation"
    scale = 128 / raw.box.width
    assert raw.mask.sum() == pytest.approx((right - left) * (bottom - top) * scale**2, rel=0.05)


def test_a_box_is_cut_at_the_border(image):
    inside = source(image, mask=None, box=(0.0, 5.0, 30.0, 40.0)).read()
    reaching = source(image, mask=None, box=(-9.0, 5.0, 30.0, 77.0)).read()
    assert inside.box == reaching.box
    assert np.array_equal(inside.mask, reaching.mask)
    assert clip_box((60.0, 0.0, 70.0, 9.0), height=HEIGHT, width=WIDTH) is None
    assert widen_box((0.0, 0.0, 10.0, 20.0), 0.1) == (-2.0, -2.0, 12.0, 22.0)


def test_content_key_changes_with_everything_that_changes_the_crop(image, tmp_path):
    base = source(image)
    other_image, mask = tmp_path / "other.png", tmp_path / "mask.png"
    photograph(other_image)
    Image.fromarray(ellipse(ANIMALS[0])).save(mask)
    changed = [
        replace(base, image=other_image), replace(base, mask=encode_mask(ellipse(ANIMALS[1]))), replace(base, mask=None),
        replace(base, crop_size=64), replace(base, mask=None, box_fill=0.6), replace(base, mask=MaskFile(mask)),
    ]  # fmt: skip
    keys = {each.content_key() for each in (base, *changed)}
    assert len(keys) == 1 + len(changed)
    assert base.content_key() == source(image, keypoints=None).content_key()
    first = replace(base, mask=MaskFile(mask)).content_key()
    Image.fromarray(ellipse(ANIMALS[1])).save(mask)
    assert replace(base, mask=MaskFile(mask)).content_key() != first
    assert isinstance(hash(base), int)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size": (61, 40)}, r"photo.png expects the annotated size 61x40, got 60x40; restore the original photograph"),
        (
            {"mask": encode_mask(np.zeros((HEIGHT, WIDTH), bool))},
            "set/file.json/1 expects an animal inside the photograph",
        ),
        ({"mask": None, "box": (90.0, 0.0, 99.0, 9.0)}, "set/file.json/1 expects a box inside the photograph"),
        ({"mask": None, "box": None}, "set/file.json/1 expects a mask or a box, got neither; leave it out"),
        ({"crop_size": 1}, "set/file.json/1 expects a visible animal, got none left at 1 px"),
    ],
)
def test_what_cannot_be_cut_is_named(image, changes, message):
    with pytest.raises(FaunaError, match=message):
        source(image, **changes).read()


def test_broken_photographs_are_named(tmp_path):
    broken = tmp_path / "broken.jpg"
    broken.write_bytes(b"no picture")
    with pytest.raises(FaunaError, match=r"broken.jpg expects a readable photograph, got .*; restore it"):
        source(broken).read()
    with pytest.raises(FaunaError, match=r"gone.jpg expects a readable image, got .*; restore it"):
        source(tmp_path / "gone.jpg").content_key()
