"""Reading photos: boxes, valid regions, resizing, distances, mirroring, the published feature codec, and bad files."""

import json

import numpy as np
import pytest
import torch
from PIL import Image

from fauna.data.crop_box import CropBox, read_box, valid_mask
from fauna.data.distance import distance_maps
from fauna.data.feature_map import decode_feature_map, encode_feature_map, read_feature_map
from fauna.data.flip import flip_keypoints, flip_photo
from fauna.data.photos import FileSource, Photo, load_photo, resize_image, resize_mask
from fauna.errors import FaunaError


def write_photo(folder, stem="a", *, side=32, suffix="png", box="0 10 20 64 64 200 150 0", mask_value=255, seed=0):
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    image = rng.integers(0, 256, (side, side, 3), dtype=np.uint8)
    mask = np.zeros((side, side), dtype=np.uint8)
    mask[side // 4 : 3 * side // 4, side // 8 : side // 2] = mask_value
    Image.fromarray(image).save(folder / f"{stem}_rgb.{suffix}")
    Image.fromarray(np.repeat(mask[..., None], 3, axis=2)).save(folder / f"{stem}_mask.png")
    (folder / f"{stem}_keypoints.json").write_text(json.dumps({"keypoints": [[0, 0, 1], [side / 2, side, 0]]}))
    (folder / f"{stem}_box.txt").write_text(box)
    return photo_at(folder, stem, suffix), image, mask


def photo_at(folder, stem="a", suffix="png"):
    parts = {
        key: folder / f"{stem}_{key}{end}" for key, end in (("mask", ".png"), ("box", ".txt"), ("keypoints", ".json"))
    }
    return Photo(stem, "horse", stem, FileSource(image=folder / f"{stem}_rgb.{suffix}", **parts))


# --- boxes -----------------------------------------------------------------------------------------------------------


def slow_valid(box, size, margin):
    result = torch.zeros(size, size)
    for row in range(size):
        for column in range(size):
            x = box.x0 + (column + 0.5) / size * box.width
            y = box.y0 + (row + 0.5) / size * box.height
            strip_x, strip_y = margin * box.width, margin * box.height
            inside = strip_x <= x <= box.photo_width - strip_x and strip_y <= y <= box.photo_height - strip_y
            result[row, column] = float(inside)
    return result


@pytest.mark.parametrize(
    "box",
    [
        CropBox(10, 20, 64, 64, 200, 150),
        CropBox(-20, -5, 60, 60, 50, 40),
        CropBox(0, 0, 100, 100, 100, 100),
        CropBox(90, 3, 50, 50, 100, 90),
    ],
)
def test_valid_mask_against_loops(box):
    assert torch.equal(valid_mask(box, size=40, margin=0.02), slow_valid(box, 40, 0.02))


def test_valid_mask_inside_touching_and_outside():
    assert valid_mask(CropBox(30, 30, 64, 64, 200, 150), size=50, margin=0.02).all()
    assert valid_mask(None, size=50, margin=0.02).all()
    touching = valid_mask(CropBox(0, 30, 50, 50, 200, 150), size=50, margin=0.02)
    assert not touching[:, 0].any()
    assert touching[:, 1:].all()
    left = valid_mask(CropBox(-25, 30, 50, 50, 200, 150), size=50, margin=0.02)
    assert not left[:, :25].any()
    assert left[:, 27:].all()
    below = valid_mask(CropBox(30, 125, 50, 50, 200, 150), size=50, margin=0.0)
    assert below[:25].all()
    assert not below[25:].any()


@pytest.mark.parametrize(
    "line", ["0 171 93 172 172 500 333 0", "frame_12 171.00 93.0 172 172 500 333", "  0 171 93 172 172 500 333 0 9\n"]
)
def test_box_file_variants(tmp_path, line):
    path = tmp_path / "a_box.txt"
    path.write_text(line)
    assert read_box(path) == CropBox(171, 93, 172, 172, 500, 333)


@pytest.mark.parametrize("line", ["", "0 1 2 3", "0 1 2 x 4 5 6", "0 1 2 0 4 5 6", "0 nan 2 3 4 5 6"])
def test_bad_box_files(tmp_path, line):
    path = tmp_path / "a_box.txt"
    path.write_text(line)
    with pytest.raises(FaunaError, match="a_box.txt expects `frame x0 y0 w h photo_w photo_h`"):
        read_box(path)


# --- loading ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_load_photo_at_its_own_size(tmp_path, suffix):
    photo, image, mask = write_photo(tmp_path, suffix=suffix)
    loaded = load_photo(photo, size=32, valid_margin=0.02)
    assert loaded.image.shape == (3, 32, 32)
    assert torch.equal(loaded.mask, torch.from_numpy((mask > 127).astype(np.float32)))
    assert loaded.valid.all()
    assert torch.allclose(loaded.keypoints, torch.tensor([[-1.0, -1.0, 1.0], [0.0, 1.0, 0.0]]))
    if suffix == "png":
        assert torch.allclose(loaded.image, torch.from_numpy(image).permute(2, 0, 1) / 255.0)


def test_mask_is_the_covered_share_of_the_area():
    mask = np.random.default_rng(0).random((32, 32)) > 0.4
    blocks = mask.reshape(8, 4, 8, 4).mean(axis=(1, 3))
    torch.testing.assert_close(resize_mask(mask, 8), torch.from_numpy(blocks).float(), atol=0.5 / 255 + 1e-6, rtol=0)
    assert set(resize_mask(mask, 32).unique().tolist()) == {0.0, 1.0}


def test_resized_image_keeps_range_and_mean():
    image = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    for size in (16, 100):
        resized = resize_image(image, size)
        assert resized.shape == (3, size, size)
        assert 0 <= resized.min() <= resized.max() <= 1
        assert resized.mean() == pytest.approx(image.mean() / 255, abs=0.01)


def test_grey_and_transparent_pictures_become_rgb(tmp_path):
    photo, image, _ = write_photo(tmp_path)
    for mode in ("L", "RGBA", "P"):
        Image.fromarray(image).convert(mode).save(tmp_path / "a_rgb.png")
        assert photo.source.read().image.shape == (32, 32, 3)


def test_content_key_follows_the_picture(tmp_path):
    first, _, _ = write_photo(tmp_path, "a", seed=0)
    again, _, _ = write_photo(tmp_path / "copy", "b", seed=0)
    other, _, _ = write_photo(tmp_path, "c", seed=1)
    assert first.source.content_key() == again.source.content_key() != other.source.content_key()


def break_photo(folder, how):
    photo, image, mask = write_photo(folder)
    match how:
        case "no image":
            (folder / "a_rgb.png").unlink()
        case "no mask":
            (folder / "a_mask.png").unlink()
        case "cut image":
            (folder / "a_rgb.png").write_bytes((folder / "a_rgb.png").read_bytes()[:900])
        case "text mask":
            (folder / "a_mask.png").write_text("not a picture")
        case "not square":
            Image.fromarray(image[:20]).save(folder / "a_rgb.png")
        case "other size":
            Image.fromarray(mask[:16, :16]).save(folder / "a_mask.png")
        case "empty mask":
            Image.fromarray(mask * 0).save(folder / "a_mask.png")
        case "zero-one mask":
            Image.fromarray(mask // 255).save(folder / "a_mask.png")
        case "keypoints":
            (folder / "a_keypoints.json").write_text('{"keypoints": [[1, 2]]}')
        case "box":
            (folder / "a_box.txt").write_text("0 1")
        case "speck":
            mask[:] = 0
            mask[5, 5] = 255
            Image.fromarray(mask).save(folder / "a_mask.png")
    return photo


BREAKAGES = {
    "no image": "a_rgb.png expects an image file, got nothing there",
    "no mask": "a_mask.png expects an image file, got nothing there",
    "cut image": "a_rgb.png expects a readable image, got a broken one",
    "text mask": "a_mask.png expects a readable image, got a broken one",
    "not square": "a_rgb.png expects a square crop, got 32x20",
    "other size": "a_mask.png expects the image's size 32x32, got 16x16",
    "empty mask": "a_mask.png expects foreground .* largest value of 0",
    "zero-one mask": "a_mask.png expects foreground .* largest value of 1",
    "keypoints": r"a_keypoints.json expects \(key, 3\) keypoints, got shape \(1, 2\)",
    "box": "a_box.txt expects",
    "speck": "photo a expects a visible animal, got none left of its mask at 8 px",
}


@pytest.mark.parametrize("how", BREAKAGES)
def test_bad_photos_are_named(tmp_path, how):
    photo = break_photo(tmp_path, how)
    with pytest.raises(FaunaError, match=BREAKAGES[how]) as caught:
        load_photo(photo, size=8, valid_margin=0.02)
    assert "\n" not in str(caught.value)


# --- distances, mirroring, feature maps ------------------------------------------------------------------------------


def test_distances_against_brute_force():
    mask = torch.from_numpy((np.random.default_rng(0).random((12, 12)) > 0.6).astype(np.float32))
    inside, outside = distance_maps(mask)
    cells = torch.stack(torch.meshgrid(torch.arange(12.0), torch.arange(12.0), indexing="ij"), -1).reshape(-1, 2)
    gaps = torch.cdist(cells, cells) / 12
    flat = mask.flatten().bool()
    nearest_background = gaps[:, ~flat].min(1).values
    nearest_foreground = gaps[:, flat].min(1).values
    assert torch.allclose(inside.flatten(), torch.where(flat, nearest_background, 0.0), atol=1e-6)
    assert torch.allclose(outside.flatten(), torch.where(flat, 0.0, nearest_foreground), atol=1e-6)


def test_distances_of_uniform_masks():
    inside, outside = distance_maps(torch.ones(4, 4))
    assert (inside == 1).all()
    assert (outside == 0).all()


def test_mirror_twice_is_the_photo(tmp_path):
    photo, _, _ = write_photo(tmp_path, box="0 -20 20 64 64 200 150 0")
    loaded = load_photo(photo, size=32, valid_margin=0.02)
    mirrored = flip_photo(loaded, swap=(1, 0))
    assert torch.equal(mirrored.image, loaded.image.flip(2))
    assert not torch.equal(mirrored.mask, loaded.mask)
    assert torch.equal(mirrored.valid[:, -1], loaded.valid[:, 0])
    assert torch.equal(mirrored.keypoints, torch.tensor([[0.0, 1.0, 0.0], [1.0, -1.0, 1.0]]))
    twice = flip_photo(mirrored, swap=(1, 0))
    for name in ("image", "mask", "valid", "keypoints"):
        assert torch.equal(getattr(twice, name), getattr(loaded, name))
    assert flip_photo(loaded, swap=None).keypoints is None


def test_mirrored_keypoints_stay_on_the_same_pixel():
    column, size = 5, 16
    point = torch.tensor([[(2 * column + 1) / size - 1, 0.0, 1.0]])
    assert flip_keypoints(point, [0])[0, 0] == pytest.approx((2 * (size - 1 - column) + 1) / size - 1)


@pytest.mark.parametrize("channels", [15, 16, 17, 18, 3])
def test_feature_codec_round_trip(channels):
    features = torch.rand(channels, 6, 6, generator=torch.Generator().manual_seed(channels)) * 2 - 1
    picture = encode_feature_map(features)
    assert picture.shape == (6, 6 * -(-channels // 3), 3)
    signed = decode_feature_map(picture, channels=channels, codec="signed")
    assert (signed - features).abs().max() <= 0.5 / 127 + 1e-6
    unit = decode_feature_map(picture, channels=channels, codec="unit")
    assert torch.allclose(unit, (signed + 1) * 127 / 255, atol=1e-6)
    assert unit.shape == features.shape
    tile = 2 if channels > 6 else 0
    assert unit[tile * 3 + 1, 4, 5] == picture[4, tile * 6 + 5, 1] / np.float32(255)


def test_feature_codec_with_a_padding_tile():
    picture = encode_feature_map(torch.zeros(15, 4, 4))
    padded = np.concatenate([picture, np.zeros((4, 4, 3), dtype=np.uint8)], axis=1)
    assert decode_feature_map(padded, channels=15, codec="signed").abs().max() == 0


def test_feature_file_of_wrong_shape(tmp_path):
    path = tmp_path / "a_feat16.png"
    Image.fromarray(encode_feature_map(torch.zeros(16, 4, 4))).save(path)
    assert read_feature_map(path, channels=16, codec="signed").shape == (16, 4, 4)
    with pytest.raises(FaunaError, match=r"expects 3 square tiles for 8 channels \(12x4\), got 24x4"):
        read_feature_map(path, channels=8, codec="signed")
    with pytest.raises(FaunaError, match="expects a readable feature map"):
        read_feature_map(tmp_path / "absent.png", channels=16, codec="unit")
