"""300 files that are no good photographs: ``python -m tests.reconstruct.bad_inputs`` runs ``fauna-reconstruct`` over all of them.

Every file is made from a seed, so that what went wrong once can be made again. Files are small on disk; what they say of themselves need not be.
"""

import argparse
import io
import json
import os
import resource
import struct
import sys
import tempfile
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

KINDS = ("JPEG", "PNG", "WEBP", "TIFF", "GIF", "BMP", "AVIF", "JPEG2000", "PPM")
SUFFIX = {"JPEG": "jpg", "JPEG2000": "jp2", "TIFF": "tif"}
COUNT = 300

Draw = np.random.Generator


@dataclass(frozen=True)
class BadInput:
    """A file.

    Attributes:
        name: with suffix.
        content: bytes.
        mask: of a mask file beside it, ``None`` without.
        refused: whether it may not be reconstructed, ``None`` where either is right.
    """

    name: str
    content: bytes
    mask: bytes | None
    refused: bool | None


def bad_inputs(count: int = COUNT, *, start: int = 0) -> list[BadInput]:
    """The files number ``start`` to ``start + count``; each depends on its number only."""
    makers = list(MAKERS.items())
    found = []
    for number in range(start, start + count):
        kind, maker = makers[number % len(makers)]
        found.append(maker(f"{number:03d}-{kind}", np.random.default_rng(number)))
    return found


def picture(draw: Draw, width: int = 160, height: int = 120) -> Image.Image:
    """Noise with a brown block: something a segmenter might take for an animal."""
    pixels = draw.integers(0, 120, (height, width, 3), dtype=np.uint8)
    pixels[height // 3 : 2 * height // 3, width // 4 : 3 * width // 4] = (150, 100, 50)
    return Image.fromarray(pixels)


def encoded(image: Image.Image, kind: str, **more: object) -> bytes:
    """The bytes of a file."""
    buffer = io.BytesIO()
    image.save(buffer, kind, **more)
    return buffer.getvalue()


def suffix(kind: str) -> str:
    """Of a format's files."""
    return SUFFIX.get(kind, kind.lower())


def block(width: int, height: int) -> bytes:
    """A mask."""
    mask = np.zeros((height, width), np.uint8)
    mask[height // 3 : 2 * height // 3, width // 4 : 3 * width // 4] = 255
    return encoded(Image.fromarray(mask), "PNG")


def png(chunks: list[tuple[bytes, bytes]]) -> bytes:
    """A PNG of given chunks."""
    body = b"".join(
        struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
        for name, content in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + body


def deflated_zeros(count: int) -> bytes:
    """``count`` zeros, compressed piece by piece."""
    packer, piece = zlib.compressobj(9), bytes(1 << 20)
    parts = [packer.compress(piece[: min(1 << 20, count - done)]) for done in range(0, count, 1 << 20)]
    return b"".join([*parts, packer.flush()])


def truncated(name: str, draw: Draw) -> BadInput:
    """A file that breaks off."""
    kind = KINDS[int(draw.integers(len(KINDS)))]
    whole = encoded(picture(draw), kind)
    return BadInput(f"{name}.{suffix(kind)}", whole[: int(len(whole) * draw.uniform(0.02, 0.9))], None, None)


def flipped(name: str, draw: Draw) -> BadInput:
    """A file with flipped bits."""
    kind = KINDS[int(draw.integers(len(KINDS)))]
    content = bytearray(encoded(picture(draw), kind))
    for place in draw.integers(0, len(content), int(draw.integers(1, 40))):
        content[place] ^= 1 << int(draw.integers(8))
    return BadInput(f"{name}.{suffix(kind)}", bytes(content), None, None)


def flipped_head(name: str, draw: Draw) -> BadInput:
    """The same in the first bytes, where sizes and kinds are written."""
    kind = KINDS[int(draw.integers(len(KINDS)))]
    content = bytearray(encoded(picture(draw), kind))
    for place in draw.integers(2, min(64, len(content)), int(draw.integers(1, 6))):
        content[place] ^= 1 << int(draw.integers(8))
    return BadInput(f"{name}.{suffix(kind)}", bytes(content), None, None)


def wrong_suffix(name: str, draw: Draw) -> BadInput:
    """A good file under another name."""
    kinds = draw.permutation(KINDS)[:2]
    return BadInput(f"{name}.{suffix(kinds[1])}", encoded(picture(draw), str(kinds[0])), block(160, 120), False)


def bomb(name: str, draw: Draw) -> BadInput:
    """A file of a few kilobytes that says it is 30,000 x 30,000, or holds it."""
    side = int(draw.choice([9000, 13000, 20000, 30000, 60000]))
    which = int(draw.integers(5))
    if which == 0:
        return BadInput(
            f"{name}.png",
            png([(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)), (b"IDAT", b"")]),
            None,
            True,
        )
    if which == 1:
        packed = deflated_zeros(9000 * (9000 // 8 + 1))
        content = png(
            [(b"IHDR", struct.pack(">IIBBBBB", 9000, 9000, 1, 0, 0, 0, 0)), (b"IDAT", packed), (b"IEND", b"")]
        )
        return BadInput(f"{name}.png", content, None, True)
    if which == 2:
        patched = bytearray(encoded(picture(draw), "BMP"))
        patched[18:26] = struct.pack("<ii", side, side)
        return BadInput(f"{name}.bmp", bytes(patched), None, True)
    if which == 3:
        patched = bytearray(encoded(picture(draw), "JPEG"))
        place = patched.index(b"\xff\xc0") + 5
        patched[place : place + 4] = struct.pack(">HH", min(side, 65500), min(side, 65500))
        return BadInput(
            f"{name}.jpg", bytes(patched), None, True if side > 13000 else None
        )  # smaller ones are read at 1/8
    patched = bytearray(encoded(picture(draw), "GIF"))
    patched[6:10] = struct.pack("<HH", min(side, 65500), min(side, 65500))
    return BadInput(f"{name}.gif", bytes(patched), None, True)


def chunk_bomb(name: str, draw: Draw) -> BadInput:
    """A small PNG with a huge compressed text or colour profile."""
    extra = zlib.compress(bytes(int(draw.integers(20, 80)) << 20), 9)
    chunk = (b"zTXt", b"Comment\0\0" + extra) if draw.integers(2) else (b"iCCP", b"profile\0\0" + extra)
    rows = b"".join(b"\0" + picture(draw).tobytes()[480 * row : 480 * (row + 1)] for row in range(120))
    content = png([
        (b"IHDR", struct.pack(">IIBBBBB", 160, 120, 8, 2, 0, 0, 0)), chunk, (b"IDAT", zlib.compress(rows)), (b"IEND", b""),
    ])  # fmt: skip
    return BadInput(f"{name}.png", content, block(160, 120), None)


def animated(name: str, draw: Draw) -> BadInput:
    """A film; some have no end."""
    kind = ("GIF", "WEBP", "PNG", "TIFF")[int(draw.integers(4))]
    frames = [picture(draw) for _ in range(int(draw.integers(2, 12)))]
    content = encoded(frames[0], kind, save_all=True, append_images=frames[1:])
    if draw.integers(3) == 0:
        content = content[: int(len(content) * 0.7)]
    return BadInput(f"{name}.{suffix(kind)}", content, block(160, 120), None)


def tiny(name: str, draw: Draw) -> BadInput:
    """1 x 1, 1 x 20000 and the like."""
    size = [(1, 1), (1, 20000), (20000, 1), (2, 3), (15, 4000), (8, 8), (15, 15)][int(draw.integers(7))]
    return BadInput(f"{name}.png", encoded(Image.new("RGB", size, (90, 60, 30)), "PNG"), None, True)


def not_a_picture(name: str, draw: Draw) -> BadInput:
    """Nothing, text, noise, other kinds of files, programs in PostScript."""
    contents = [
        b"", b"hello", b"\0" * 4096, draw.bytes(5000), b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 100 100\nshowpage\n",
        b'<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"/>', b"PK\x03\x04" + draw.bytes(300), b"\xff\xd8\xff",
        b"\x89PNG\r\n\x1a\n", b"GIF89a", b"RIFF\x10\0\0\0WEBP", b"II*\0\x08\0\0\0\xff\xff", b"BM", b"P6\n", b"%PDF-1.7\n", b"\x7fELF",
    ]  # fmt: skip
    kind = str(draw.choice(["jpg", "png", "webp", "tif", "gif", "bmp"]))
    return BadInput(f"{name}.{kind}", contents[int(draw.integers(len(contents)))], None, True)


def one_colour(name: str, draw: Draw) -> BadInput:
    """Nothing to see."""
    width, height = (int(side) for side in draw.integers(16, 700, 2))
    colour = tuple(int(value) for value in draw.choice([0, 128, 255], 3))
    kind = KINDS[int(draw.integers(len(KINDS)))]
    return BadInput(f"{name}.{suffix(kind)}", encoded(Image.new("RGB", (width, height), colour), kind), None, True)


def odd_pixels(name: str, draw: Draw) -> BadInput:
    """16 and 32 bits, palettes, CMYK, transparency of every kind, numbers that are none."""
    which = int(draw.integers(8))
    plain = picture(draw)
    grey = np.asarray(plain.convert("L")).astype(np.float32)
    if which == 0:
        image, kind = Image.fromarray((grey * 257).astype(np.uint16)), "PNG"
    elif which == 1:
        grey[::7] = np.nan
        grey[::11] = np.inf
        image, kind = Image.fromarray(grey), "TIFF"
    elif which == 2:
        image, kind = plain.convert("CMYK"), "JPEG"
    elif which == 3:
        image, kind = plain.quantize(int(draw.integers(2, 256))), "PNG"
    elif which == 4:
        image, kind = Image.fromarray(-grey * 1e30), "TIFF"
    elif which == 5:
        alpha = draw.integers(0, 255, (120, 160), dtype=np.uint8)
        image, kind = Image.fromarray(np.dstack([np.asarray(plain), alpha])), "WEBP"
    elif which == 6:
        image, kind = Image.fromarray(np.dstack([np.asarray(plain), np.zeros((120, 160), np.uint8)])), "PNG"
    else:
        image, kind = plain.convert("1"), "TIFF"
    return BadInput(f"{name}.{suffix(kind)}", encoded(image, kind), None, None)


def odd_notes(name: str, draw: Draw) -> BadInput:
    """EXIF and colour profiles that make no sense."""
    which = int(draw.integers(4))
    if which == 0:
        exif = Image.Exif()
        exif[0x0112] = int(draw.integers(0, 60000))
        return BadInput(f"{name}.jpg", encoded(picture(draw), "JPEG", exif=exif), block(160, 120), None)
    if which == 1:
        return BadInput(
            f"{name}.jpg", encoded(picture(draw), "JPEG", exif=b"Exif\0\0" + draw.bytes(200)), block(160, 120), None
        )
    kind = ("JPEG", "PNG", "WEBP")[int(draw.integers(3))]
    return BadInput(
        f"{name}.{suffix(kind)}", encoded(picture(draw), kind, icc_profile=draw.bytes(500)), block(160, 120), None
    )


def bad_mask(name: str, draw: Draw) -> BadInput:
    """A good photograph with a mask that is empty, full, of another size, damaged, or a bomb."""
    whole = block(160, 120)
    masks = [
        encoded(Image.new("L", (160, 120)), "PNG"), encoded(Image.new("L", (161, 200), 255), "PNG"), b"", whole[:60],
        b"text", encoded(Image.new("L", (1, 1), 255), "PNG"),
        png([(b"IHDR", struct.pack(">IIBBBBB", 16000, 12000, 8, 0, 0, 0, 0)), (b"IDAT", b"")]),
    ]  # fmt: skip
    return BadInput(f"{name}.png", encoded(picture(draw), "PNG"), masks[int(draw.integers(len(masks)))], True)


def odd_mask(name: str, draw: Draw) -> BadInput:
    """Masks of everything, of a line, of a chessboard, of many dots."""
    rows, columns = np.mgrid[:120, :160]
    masks = [
        np.ones((120, 160), bool), rows == 60, (rows + columns) % 2 == 0, (rows % 20 < 6) & (columns % 20 < 6),
        (rows < 40) & (columns > 120), draw.random((120, 160)) > 0.5, columns == 80, (rows > 10) ^ (columns > 10),
    ]  # fmt: skip
    mask = masks[int(draw.integers(len(masks)))].astype(np.uint8) * np.uint8(255)
    return BadInput(f"{name}.png", encoded(picture(draw), "PNG"), encoded(Image.fromarray(mask), "PNG"), None)


MAKERS: dict[str, Callable[[str, Draw], BadInput]] = {
    "truncated": truncated,
    "flipped": flipped,
    "flipped-head": flipped_head,
    "suffix": wrong_suffix,
    "bomb": bomb,
    "chunk-bomb": chunk_bomb,
    "animated": animated,
    "tiny": tiny,
    "no-picture": not_a_picture,
    "one-colour": one_colour,
    "odd-pixels": odd_pixels,
    "odd-notes": odd_notes,
    "bad-mask": bad_mask,
    "odd-mask": odd_mask,
}


def put(folder: Path, inputs: list[BadInput]) -> list[Path]:
    """Write the files, masks beside them; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    for each in inputs:
        (folder / each.name).write_bytes(each.content)
        if each.mask is not None:
            (folder / f"{Path(each.name).stem}_mask.png").write_bytes(each.mask)
    return [folder / each.name for each in inputs]


def complaints(inputs: list[BadInput], out: Path) -> list[str]:
    """What is wrong with the results: a folder or a reason that is missing, a defect of ours, a bad input that was taken."""
    from fauna.reconstruct.status import MEANINGS

    found = []
    for each in inputs:
        try:
            content = json.loads((out / Path(each.name).stem / "result.json").read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            found.append(f"{each.name}: no result ({error})")
            continue
        status, reason = content["status"], content["reason"]
        if status not in MEANINGS or (status == "failed" and "FAUNA_DEBUG" in reason):
            found.append(f"{each.name}: {status}: {reason}")
        if content["animal"] is None and (not reason or "\n" in reason):
            found.append(f"{each.name}: {status} without a reason")
        if each.refused is not None and each.refused != (content["animal"] is None):
            found.append(f"{each.name}: expected refused={each.refused}, got {status}: {reason}")
    return found


def main() -> None:
    """Run the command over all of them; print statuses, complaints and the largest memory."""
    parser = argparse.ArgumentParser(description="fauna-reconstruct over files that are no good photographs.")
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--start", type=int, default=0)
    given = parser.parse_args()
    from fauna.reconstruct.command import main as reconstruct

    inputs = bad_inputs(given.count, start=given.start)
    with tempfile.TemporaryDirectory() as root:
        paths = put(Path(root) / "in", inputs)
        out = Path(root) / "out"
        sys.argv = [
            "fauna-reconstruct",
            *map(str, paths),
            "-o",
            str(out),
            "--no-finetune",
            "--no-viewer",
            "--no-turntable",
        ]
        code: object = None
        try:
            reconstruct()
        except SystemExit as stop:
            code = stop.code
        told = complaints(inputs, out)
        results = [json.loads(path.read_text()) for path in out.glob("*/result.json")]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 if sys.platform == "darwin" else 1024)
    print(f"exit code {code}, {len(results)} results: {dict(Counter(each['status'] for each in results))}")
    print(f"largest memory {peak:.0f} MiB")
    print(*(told or ["no complaints"]), sep="\n")
    sys.exit(1 if told or code != 1 else 0)


if __name__ == "__main__":
    os.environ.setdefault("HF_HUB_OFFLINE", "1")
    main()
