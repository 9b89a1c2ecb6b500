"""Run lengths against a slow reference and hand-made strings; polygons against an even-odd test per pixel."""

import numpy as np
import pytest
from PIL import Image

from fauna.data.readers.masks import MaskFile, Polygons, Rle, decode_counts, encode_mask, parse_segmentation
from fauna.errors import FaunaError
from tests.data.readers.fixtures import compress, runs


def masks() -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    drawn = [rng.random((h, w)) < p for h, w, p in ((1, 1, 0.5), (7, 5, 0.3), (64, 48, 0.5), (90, 200, 0.01))]
    return [*drawn, np.ones((6, 4), bool), np.zeros((6, 4), bool)]


@pytest.mark.parametrize("mask", masks(), ids=lambda mask: f"{mask.shape[0]}x{mask.shape[1]}-{mask.mean():.2f}")
def test_runs_of_any_mask_come_back(mask):
    height, width = mask.shape
    counts = runs(mask)
    for rle in (Rle(height, width, tuple(counts)), Rle(height, width, compress(counts)), encode_mask(mask)):
        assert np.array_equal(rle.decode(height, width), mask)
    assert encode_mask(mask).counts == tuple(counts)


def test_hand_made_strings():
    # one character is a number below 16; 'P1' is 0 + 32 (more follow), then 1 * 32; 'O' is -1
    assert decode_counts("52203").tolist() == [5, 2, 2, 2, 5]
    assert decode_counts("P1").tolist() == [32]
    assert decode_counts("111O").tolist() == [1, 1, 1, 0]
    assert decode_counts("0" + "oo1").tolist() == [0, 31 + 31 * 32 + 1024]


def test_compression_of_large_and_falling_runs():
    counts = [0, 5000, 70000, 3, 1, 640 * 480, 2]
    assert decode_counts(compress(counts)).tolist() == counts


@pytest.mark.parametrize(
    ("rle", "message"),
    [
        (Rle(2, 3, (1, 2)), "expects runs that fill 3x2 pixels, got 3; mend or remove"),
        (Rle(2, 3, (7, -1)), "expects runs that fill 3x2 pixels, got 6"),
        (Rle(2, 3, "P"), "expects a complete last number, got one that breaks off"),
        (Rle(2, 3, "5 1"), r"expects characters from '0' to 'o', got ' '"),
        (Rle(3, 2, (6,)), "expects the photograph's size 3x2, got 2x3; restore the originals"),
    ],
)
def test_broken_runs_are_named(rle, message):
    with pytest.raises(FaunaError, match=message):
        rle.decode(2, 3)


def inside(x: float, y: float, ring: list[float]) -> bool:
    points = list(zip(ring[::2], ring[1::2], strict=True))
    odd = False
    for (x0, y0), (x1, y1) in zip(points, points[1:] + points[:1], strict=True):
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) / (y1 - y0) * (x1 - x0):
            odd = not odd
    return odd


def test_polygons_hold_the_pixels_whose_centre_is_inside():
    rng = np.random.default_rng(1)
    rings = [(rng.random(2 * corners) * 20 - 2).tolist() for corners in (3, 4, 5)]
    mask = Polygons(tuple(map(tuple, rings))).decode(14, 17)
    expected = [[any(inside(x + 0.5, y + 0.5, ring) for ring in rings) for x in range(17)] for y in range(14)]
    assert np.array_equal(mask, expected)
    assert 20 < mask.sum() < 200


def test_segmentations_of_every_kind():
    square = [2.0, 1.0, 5.0, 1.0, 5.0, 4.0, 2.0, 4.0]
    expected = np.zeros((6, 8), bool)
    expected[1:4, 2:5] = True
    counts = runs(expected)
    kinds = (
        [square],
        {"size": [6, 8], "counts": counts},
        {"size": [6, 8], "counts": compress(counts)},
        compress(counts),
    )
    for kind in kinds:
        mask = parse_segmentation(kind, 6, 8)
        assert mask is not None
        assert np.array_equal(mask.decode(6, 8), expected)
        assert hash(mask) == hash(parse_segmentation(kind, 6, 8))
    for nothing in (None, [], "", {}, [[1.0, 2.0]]):
        assert parse_segmentation(nothing, 6, 8) is None
    for broken in ({"size": [6, 8]}, [["a", "b"]], 3):
        with pytest.raises(FaunaError, match="segmentation expects polygons or run lengths, got .*; mend the file"):
            parse_segmentation(broken, 6, 8)


def test_mask_files(tmp_path):
    mask = np.zeros((6, 8), np.uint8)
    mask[1:4, 2:5] = 1
    for values, mode in ((mask * 255, "L"), (mask, "L"), (mask * 128, "L"), (mask * 255, "RGB")):
        Image.fromarray(values).convert(mode).save(tmp_path / "mask.png")
        assert np.array_equal(MaskFile(tmp_path / "mask.png").decode(6, 8), mask == 1)
    with pytest.raises(FaunaError, match=r"mask.png expects the photograph's size 9x6, got 8x6"):
        MaskFile(tmp_path / "mask.png").decode(6, 9)
    with pytest.raises(FaunaError, match=r"gone.png expects a readable mask, got FileNotFoundError .*; restore it"):
        MaskFile(tmp_path / "gone.png").decode(6, 8)
