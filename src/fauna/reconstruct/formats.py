"""Which picture formats are read, and what their files are called."""

SUFFIXES = {
    "JPEG": (".jpg", ".jpeg", ".jpe", ".jfif"),
    "MPO": (".jpg", ".jpeg", ".mpo"),
    "PNG": (".png", ".apng"),
    "WEBP": (".webp",),
    "TIFF": (".tif", ".tiff"),
    "BMP": (".bmp", ".dib"),
    "GIF": (".gif",),
    "AVIF": (".avif", ".avifs"),
    "JPEG2000": (".jp2", ".j2k", ".jpx", ".jpf", ".jpc"),
    "PPM": (".ppm", ".pgm", ".pbm", ".pnm"),
}
"""Formats by Pillow's names, told by the content. Others stay closed: some run programs."""

PHOTO_SUFFIXES = frozenset(suffix for names in SUFFIXES.values() for suffix in names)
OPENED = tuple(name for name in SUFFIXES if name != "MPO")
"""What Pillow is allowed to try; it finds MPO by way of JPEG."""
