import numpy as np
import pytest
from PIL import Image

from fauna.reconstruct.mask_files import alpha_mask, array_masks, masks_beside, read_masks
from fauna.reconstruct.photograph import read_photograph
from fauna.reconstruct.settings import default_settings
from fauna.reconstruct.status import Refused

SETTINGS = default_settings()


@pytest.fixture
def photograph(picture):
    path, disc = picture()
    return read_photograph(path, SETTINGS.photo), disc


def save(tmp_path, array, name="m.png", **more):
    path = tmp_path / name
    Image.fromarray(array).save(path, **more)
    return path


def test_masks_of_every_kind_are_the_same_mask(tmp_path, photograph):
    found, disc = photograph
    eight = disc.astype(np.uint8) * np.uint8(255)
    kinds = {
        "eight.png": eight,
        "ones.png": disc.astype(np.uint8),
        "bits.png": disc,
        "rgb.png": np.dstack([eight] * 3),
        "cutout.png": np.dstack([np.full((*disc.shape, 3), 9, np.uint8), eight]),
    }
    for name, array in kinds.items():
        masks = read_masks([save(tmp_path, array, name)], found, "given", SETTINGS.mask).masks
        assert len(masks) == 1
        assert (masks[0] == disc).all(), name


def test_labels_of_a_palette_are_animals_each(tmp_path, photograph):
    found, disc = photograph
    labels = np.zeros(disc.shape, np.uint8)
    labels[:10, :10], labels[disc] = 2, 1
    picture = Image.fromarray(labels, mode="P")
    picture.putpalette([0, 0, 0, 128, 0, 0, 0, 128, 0])
    picture.save(tmp_path / "m.png")
    masks = read_masks([tmp_path / "m.png"], found, "given", SETTINGS.mask).masks
    assert [int(mask.sum()) for mask in masks] == [int((labels == 1).sum()), 100]


def test_a_grey_palette_is_no_list_of_labels(tmp_path, photograph):
    found, disc = photograph
    picture = Image.fromarray(disc.astype(np.uint8) * np.uint8(200) + np.uint8(20), mode="P")
    picture.putpalette([value for grey in range(256) for value in (grey,) * 3])
    picture.save(tmp_path / "m.png")
    (mask,) = read_masks([tmp_path / "m.png"], found, "given", SETTINGS.mask).masks
    assert (mask == disc).all()


def test_of_many_labels_the_largest_are_taken(tmp_path, photograph):
    found, _ = photograph
    labels = np.arange(64 * 96).reshape(64, 96) % 200
    picture = Image.fromarray(labels.astype(np.uint8), mode="P")
    picture.putpalette([value for index in range(256) for value in (index, 255 - index, 7)])
    picture.save(tmp_path / "m.png")
    assert len(read_masks([tmp_path / "m.png"], found, "given", SETTINGS.mask).masks) == SETTINGS.mask.max_animals


def test_a_mask_of_the_turned_photograph_is_turned_too(tmp_path, picture):
    path, disc = picture()
    disc = disc.copy()
    disc[:5, :9] = True
    exif = Image.Exif()
    exif[0x0112] = 6
    with Image.open(path) as original:
        original.save(tmp_path / "turned.png", exif=exif)
    found = read_photograph(tmp_path / "turned.png", SETTINGS.photo)
    eight = disc.astype(np.uint8) * np.uint8(255)
    upright = np.rot90(disc, -1)
    for array in (eight, np.ascontiguousarray(np.rot90(eight, -1))):
        (mask,) = read_masks([save(tmp_path, array)], found, "given", SETTINGS.mask).masks
        assert (mask == upright).all()


def test_a_reduced_mask_is_enlarged_and_told(tmp_path, photograph):
    found, disc = photograph
    small = np.array(Image.fromarray(disc.astype(np.uint8) * np.uint8(255)).resize((48, 32), Image.Resampling.BOX))
    read = read_masks([save(tmp_path, small)], found, "given", SETTINGS.mask)
    assert read.flags == ("mask_resized",)
    assert (read.masks[0] & disc).sum() / (read.masks[0] | disc).sum() > 0.9


@pytest.mark.parametrize("shape", [(64, 64), (640, 1000), (1, 1)])
def test_masks_of_other_photographs_are_refused(tmp_path, photograph, shape):
    path = save(tmp_path, np.zeros(shape, np.uint8))
    with pytest.raises(Refused, match="photograph's size 96x64") as caught:
        read_masks([path], photograph[0], "given", SETTINGS.mask)
    assert caught.value.status == "bad_mask"


def test_a_broken_mask_is_refused(tmp_path, photograph):
    (tmp_path / "m.png").write_text("no mask")
    with pytest.raises(Refused, match="readable mask"):
        read_masks([tmp_path / "m.png"], photograph[0], "given", SETTINGS.mask)


def test_arrays(photograph):
    found, disc = photograph
    for mask in (disc, disc.astype(np.uint8) * np.uint8(255)):
        assert (array_masks([mask], found).masks[0] == disc).all()
    for bad in (disc[1:], disc.astype(float), disc[None]):
        with pytest.raises(Refused, match="one value for each pixel"):
            array_masks([bad], found)


@pytest.mark.parametrize(
    ("files", "found"),
    [
        (["x_mask.png", "masks/x.png"], ["x_mask.png"]),
        (
            ["masks/x.png", "masks/x_1.png", "masks/x-2.png", "masks/x2.png", "masks/xy.png"],
            ["x-2.png", "x.png", "x_1.png"],
        ),
        (["y_mask.png"], []),
    ],
)
def test_masks_beside_a_photograph(tmp_path, files, found):
    (tmp_path / "masks").mkdir()
    for name in files:
        (tmp_path / name).touch()
    assert [each.name for each in masks_beside(tmp_path / "x.jpg")] == found


def test_masks_of_the_crop_layout(tmp_path):
    (tmp_path / "0001_mask.png").touch()
    assert [each.name for each in masks_beside(tmp_path / "0001_rgb.jpg")] == ["0001_mask.png"]


@pytest.mark.parametrize(
    ("alpha", "counts"),
    [
        (lambda disc: disc * 255, True),
        (lambda disc: disc * 0 + 255, False),
        (lambda disc: disc * 0, False),
        (lambda disc: disc * 0 + np.arange(96)[None] * 2, False),
    ],
    ids=["cutout", "opaque", "transparent", "gradient"],
)
def test_alpha_counts_when_it_separates(tmp_path, photograph, alpha, counts):
    found, disc = photograph
    rgba = np.dstack([found.image, alpha(disc.astype(int)).astype(np.uint8)])
    masks = alpha_mask(read_photograph(Image.fromarray(rgba), SETTINGS.photo), SETTINGS.mask)
    assert (masks is not None) == counts
    if masks is not None:
        assert (masks.masks[0] == disc).all()
