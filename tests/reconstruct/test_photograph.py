import io
import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageCms

from fauna.reconstruct.photograph import read_photograph
from fauna.reconstruct.settings import default_settings
from fauna.reconstruct.status import Refused

SETTINGS = default_settings().photo


def gradient(width=80, height=48):
    rows, columns = np.mgrid[:height, :width]
    return np.stack([columns * 255 // width, rows * 255 // height, np.full((height, width), 90)], 2).astype(np.uint8)


def read(tmp_path, name, save):
    path = tmp_path / name
    save(path)
    return read_photograph(path, SETTINGS)


def test_plain_png_keeps_every_value(tmp_path):
    found = read(tmp_path, "a.png", Image.fromarray(gradient()).save)
    assert (found.image == gradient()).all()
    assert (found.name, found.format, found.size, found.flags) == ("a", "PNG", (80, 48), ())
    assert found.alpha is None
    assert len(found.sha256) == 64


@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientations_end_upright(tmp_path, orientation):
    turned = {
        1: gradient(), 2: gradient()[:, ::-1], 3: gradient()[::-1, ::-1], 4: gradient()[::-1],
        5: gradient().transpose(1, 0, 2), 6: np.rot90(gradient(), 1), 7: gradient()[::-1, ::-1].transpose(1, 0, 2),
        8: np.rot90(gradient(), -1),
    }[orientation]  # fmt: skip
    exif = Image.Exif()
    exif[0x0112] = orientation
    found = read(tmp_path, "a.png", lambda path: Image.fromarray(np.ascontiguousarray(turned)).save(path, exif=exif))
    assert (found.image == gradient()).all()
    assert found.size == (80, 48)
    assert ("rotated" in found.flags) == (orientation > 1)


@pytest.mark.parametrize(
    ("mode", "tolerance"), [("L", 0), ("1", 255), ("P", 60), ("CMYK", 4), ("YCbCr", 6), ("I;16", 1), ("I", 1), ("F", 1)]
)
def test_modes_become_rgb(tmp_path, mode, tolerance):
    grey = np.array(Image.fromarray(gradient()).convert("L"))
    if mode == "I;16":
        picture = Image.fromarray(grey.astype(np.uint16) * 257)
    elif mode in ("I", "F"):
        picture = Image.fromarray(grey.astype(np.int32) * 257 if mode == "I" else grey / np.float32(255.0))
    else:
        picture = Image.fromarray(gradient()).convert(mode)
    kind = "tiff" if mode in ("CMYK", "F", "I") else "png"
    if mode == "YCbCr":
        kind = "jpg"
    found = read(tmp_path, f"a.{kind}", lambda path: picture.save(path, quality=100, subsampling=0))
    wanted = gradient() if mode in ("P", "CMYK", "YCbCr") else grey[..., None].repeat(3, 2)
    assert found.image.shape == (48, 80, 3)
    assert found.image.dtype == np.uint8
    assert np.abs(found.image.astype(int) - wanted).max() <= tolerance


def test_alpha_is_kept_and_transparent_pixels_turn_grey(tmp_path):
    rgba = np.dstack([gradient(), np.full((48, 80), 255, np.uint8)])
    rgba[:, :40, 3] = 0
    found = read(tmp_path, "a.png", Image.fromarray(rgba).save)
    assert (found.alpha == rgba[..., 3]).all()
    assert (found.image[:, :40] == 127).all()
    assert (found.image[:, 40:] == gradient()[:, 40:]).all()


def test_a_palette_with_a_transparent_colour_has_alpha(tmp_path):
    picture = Image.fromarray(np.repeat([0, 1], 800).reshape(40, 40).astype(np.uint8), mode="P")
    picture.putpalette([0, 0, 0, 255, 0, 0])
    found = read(tmp_path, "a.gif", lambda path: picture.save(path, transparency=0))
    assert found.alpha is not None
    assert (found.alpha[:20] == 0).all()
    assert (found.image[20:] == (255, 0, 0)).all()


@pytest.mark.parametrize("kind", ["GIF", "WEBP", "PNG"])
def test_animated_files_give_their_first_picture(tmp_path, kind):
    frames = [Image.fromarray(np.full((40, 40, 3), value, np.uint8)) for value in (250, 10, 100)]
    save = lambda path: frames[0].save(path, kind, save_all=True, append_images=frames[1:], lossless=True)  # noqa: E731
    found = read(tmp_path, f"a.{kind.lower()}", save)
    assert "animated" in found.flags
    assert np.abs(found.image.astype(int) - 250).max() <= 2


def test_wrong_suffix_is_told_not_refused(tmp_path):
    found = read(tmp_path, "a.jpg", lambda path: Image.fromarray(gradient()).save(path, "PNG"))
    assert found.flags == ("wrong_suffix",)
    assert found.format == "PNG"


@pytest.mark.parametrize(("name", "tolerance"), [("a.jpg", 12), ("a.png", 3)])
def test_large_photographs_are_reduced(tmp_path, name, tolerance):
    large = Image.fromarray(gradient()).resize((2400, 1440), Image.Resampling.BICUBIC)
    large.save(tmp_path / name)
    found = read_photograph(tmp_path / name, replace(SETTINGS, work_side=500))
    assert found.image.shape == (300, 500, 3)
    assert found.size == (2400, 1440)
    assert found.scale == pytest.approx(4.8)
    assert "reduced" in found.flags
    wanted = np.array(large.resize((500, 300), Image.Resampling.BOX)).astype(int)
    assert np.abs(found.image - wanted).max() <= tolerance


def test_colour_profiles_are_applied_and_damaged_ones_ignored(tmp_path):
    lab = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    plain = Image.fromarray(gradient())
    assert read(tmp_path, "a.png", lambda path: plain.save(path, icc_profile=lab)).flags == ()
    broken = read(tmp_path, "b.png", lambda path: plain.save(path, icc_profile=b"no profile"))
    assert broken.flags == ("colour_profile_ignored",)
    assert (broken.image == gradient()).all()


def corrupt(path, kind, at, content):
    buffer = io.BytesIO()
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (48, 80, 3), dtype=np.uint8)).save(buffer, kind)
    data = buffer.getvalue()
    path.write_bytes(data[:at] + content)


def png_header(path, width, height):
    """A picture that says it is large, and holds nothing."""
    chunks = (b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0), b"IDAT" + zlib.compress(b""))
    framed = (struct.pack(">I", len(each) - 4) + each + struct.pack(">I", zlib.crc32(each)) for each in chunks)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(framed))


@pytest.mark.parametrize(
    ("make", "status", "words"),
    [
        (lambda path: path.write_bytes(b""), "unreadable", "empty file"),
        (lambda path: path.write_text("hello"), "unreadable", "another kind"),
        (lambda path: path.mkdir(), "unreadable", "no file"),
        (lambda path: None, "unreadable", "no file"),
        (lambda path: corrupt(path, "PNG", 1000, b""), "unreadable", "damaged"),
        (lambda path: corrupt(path, "JPEG", 1500, b""), "unreadable", "damaged"),
        (lambda path: corrupt(path, "PNG", 60, b"\0" * 5000), "unreadable", "damaged"),
        (lambda path: Image.new("L", (1, 1)).save(path, "PNG"), "too_small", "1x1"),
        (lambda path: Image.new("L", (1, 20000)).save(path, "PNG"), "too_small", "1x20000"),
        (lambda path: png_header(path, 12000, 12000), "too_large", "64 million pixels"),
        (lambda path: png_header(path, 30000, 30000), "too_large", "too many pixels"),
        (lambda path: path.write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 99 99\n"), "unreadable", "kind"),
    ],
)
def test_what_cannot_be_used_is_refused_with_a_reason(tmp_path, make, status, words):
    path = tmp_path / "x.png"
    make(path)
    with pytest.raises(Refused, match=words) as caught:
        read_photograph(path, SETTINGS)
    assert caught.value.status == status
    assert "\n" not in str(caught.value)


def test_arrays_and_pil_pictures_are_read_like_files(tmp_path):
    from_array = read_photograph(gradient(), SETTINGS)
    from_picture = read_photograph(Image.fromarray(gradient()), SETTINGS)
    assert (from_array.image == gradient()).all()
    assert from_array.sha256 == from_picture.sha256
    assert (from_array.name, from_array.path) == ("photo", None)
    for bad in (gradient().astype(float), gradient()[..., :2], np.zeros((0, 5, 3), np.uint8)):
        with pytest.raises(Refused, match="8-bit RGB"):
            read_photograph(bad, SETTINGS)
