"""Colours of any kind to 8-bit RGB, and the turn that a camera noted."""

import io

import numpy as np
from PIL import Image, ImageCms

ORIENTATION = 0x0112
BACKDROP = 127
"""Grey behind transparent pixels, whose own colours mean nothing."""
TURNS = {
    2: (Image.Transpose.FLIP_LEFT_RIGHT,),
    3: (Image.Transpose.ROTATE_180,),
    4: (Image.Transpose.FLIP_TOP_BOTTOM,),
    5: (Image.Transpose.TRANSPOSE,),
    6: (Image.Transpose.ROTATE_270,),
    7: (Image.Transpose.TRANSVERSE,),
    8: (Image.Transpose.ROTATE_90,),
}
"""EXIF orientation -> what makes the picture upright."""


def read_orientation(picture: Image.Image) -> int:
    """EXIF orientation, 1 (upright) where there is none or the notes are damaged."""
    try:
        value = picture.getexif().get(ORIENTATION, 1)
    except Exception:  # damaged notes raise anything; the picture itself may be fine
        return 1
    return value if value in TURNS else 1


def oriented(picture: Image.Image, orientation: int) -> Image.Image:
    """The picture turned upright."""
    for turn in TURNS.get(orientation, ()):
        picture = picture.transpose(turn)
    return picture


def to_rgb(picture: Image.Image, shrink: float) -> tuple[Image.Image, Image.Image | None, bool]:
    """8-bit RGB, reduced, and the alpha channel if there is one.

    Args:
        picture: decoded, of any mode.
        shrink: factor by which its sides are divided, if above 1.

    Returns:
        RGB (over grey where transparent), alpha (mode L) or ``None``, and whether its colour profile could be used.
    """
    profile = picture.info.get("icc_profile")
    transparent = "transparency" in picture.info or picture.mode in ("RGBA", "LA", "PA", "La", "RGBa")
    width, height = (max(round(side / max(shrink, 1.0)), 1) for side in picture.size)
    picture = _eight_bits(picture)
    if transparent:
        picture = picture.convert("RGBA")
    elif picture.mode in ("P", "1", "PA"):
        picture = picture.convert("RGB")
    if (width, height) != picture.size:
        picture = picture.resize((width, height), Image.Resampling.BILINEAR, reducing_gap=2.0)
    alpha = picture.getchannel("A") if transparent else None
    rgb, used = _managed(picture.convert("RGB") if transparent else picture, profile)
    if alpha is not None:
        rgb = Image.composite(rgb, Image.new("RGB", rgb.size, (BACKDROP,) * 3), alpha)
    return rgb, alpha, used


def _eight_bits(picture: Image.Image) -> Image.Image:
    """Pictures of 16 or 32 bits as 8-bit grey; others as they are."""
    if not picture.mode.startswith(("I", "F")):
        return picture
    values = np.asarray(picture)
    if picture.mode.startswith("I;16"):
        return Image.fromarray((values >> 8).astype(np.uint8))
    values = np.nan_to_num(values.astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    top = float(values.max(initial=0.0))
    full = next((limit for limit in (1.0, 255.0, 65535.0) if top <= limit), top)
    return Image.fromarray((np.clip(values, 0.0, None) * (255.0 / full)).astype(np.uint8))


def _managed(picture: Image.Image, profile: bytes | None) -> tuple[Image.Image, bool]:
    """The picture in sRGB, by its own colour profile if it has one; and whether that went well."""
    plain = picture.mode in ("RGB", "CMYK", "L")
    if not profile or not plain:
        return picture.convert("RGB"), True
    try:
        theirs = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        if "sRGB" in ImageCms.getProfileDescription(theirs):
            return picture.convert("RGB"), True
        managed = ImageCms.profileToProfile(picture, theirs, ImageCms.createProfile("sRGB"), outputMode="RGB")
    except Exception:  # damaged or foreign profiles raise several kinds
        return picture.convert("RGB"), False
    return (managed or picture.convert("RGB")), True
