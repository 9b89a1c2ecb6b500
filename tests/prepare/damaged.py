"""1,000 files that are damaged, odd or hostile, each a pure function of its number.

The makers of ``tests/reconstruct/bad_inputs.py`` and more: pictures that are odd but good (CMYK, 16 bits, palettes, transparency, turned by
their notes), long thin ones, masks of other pictures, and names that are no UTF-8. Every maker takes its turn.

``python -m tests.prepare.damaged`` prepares all of them and compares with the verdicts of ``damaged_verdicts.tsv``.
"""

import argparse
import csv
import io
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import PIL
from PIL import Image

from fauna.prepare.place import manifest_files
from fauna.prepare.reasons import REASONS
from fauna.prepare.settings import Settings, prepare_settings
from fauna.prepare.sources.detect import open_source
from fauna.prepare.steps import build_step
from fauna.prepare.tables import read_table
from fauna.prepare.workspace import Workspace, text_of_path
from tests.reconstruct import bad_inputs as basic
from tests.reconstruct.bad_inputs import BadInput, Draw, encoded, picture

COUNT = 1000
WIDTH, HEIGHT = 160, 120
ORIENTATION = 0x0112
TABLE = Path(__file__).with_name("damaged_verdicts.tsv")


@dataclass(frozen=True)
class Damaged:
    """A file of a species folder.

    Attributes:
        number: from 0; everything else follows from it.
        kind: its maker.
        name: of the file; bytes that are no UTF-8 are escaped as ``os.fsdecode`` does.
        content: bytes.
        mask: of ``<stem>_mask.png`` beside it, ``None`` without.
        usable: whether it must be used (True), must be skipped (False), or either is right (None): then the table decides.
    """

    number: int
    kind: str
    name: str
    content: bytes
    mask: bytes | None
    usable: bool | None


def upright_mask(draw: Draw) -> bytes:
    """An animal-like block with legs in the middle of the usual picture."""
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    top, left = int(draw.integers(25, 40)), int(draw.integers(25, 45))
    mask[top : top + 35, left : left + 80] = 255
    for leg in (0, 16, 56, 72):
        mask[top + 35 : top + 60, left + leg : left + leg + 8] = 255
    return encoded(Image.fromarray(mask), "PNG")


def scene(draw: Draw) -> Image.Image:
    """A sharp picture that shows something."""
    return picture(draw, WIDTH, HEIGHT)


def good(name: str, draw: Draw) -> BadInput:
    """Nothing is wrong with it: every format that is read."""
    kind = basic.KINDS[int(draw.integers(len(basic.KINDS)))]
    return BadInput(f"{name}.{basic.suffix(kind)}", encoded(scene(draw), kind), upright_mask(draw), False)


def cmyk(name: str, draw: Draw) -> BadInput:
    """Four inks, as JPEG or TIFF, or inverted as some programs write them: then too dark to show much."""
    inks = scene(draw).convert("CMYK")
    kind = ("JPEG", "TIFF")[int(draw.integers(2))]
    inverted = kind == "TIFF" and bool(draw.integers(2))
    if inverted:
        inks = Image.merge("CMYK", [band.point(lambda value: 255 - value) for band in inks.split()])
    return BadInput(
        f"{name}.{basic.suffix(kind)}", encoded(inks, kind), upright_mask(draw), None if inverted else False
    )


def sixteen(name: str, draw: Draw) -> BadInput:
    """16 bits a pixel, PNG or TIFF."""
    grey = np.asarray(scene(draw).convert("L")).astype(np.uint16) * 257
    kind = ("PNG", "TIFF")[int(draw.integers(2))]
    return BadInput(f"{name}.{basic.suffix(kind)}", encoded(Image.fromarray(grey), kind), upright_mask(draw), False)


def palette(name: str, draw: Draw) -> BadInput:
    """Few colours, also with a transparent one, also black and white only."""
    which = int(draw.integers(3))
    if which == 2:
        return BadInput(f"{name}.png", encoded(scene(draw).convert("1"), "PNG"), upright_mask(draw), False)
    image = scene(draw).quantize(int(draw.choice([4, 16, 200])))
    more = {"transparency": 0} if which else {}
    kind = ("PNG", "GIF")[int(draw.integers(2))]
    return BadInput(f"{name}.{basic.suffix(kind)}", encoded(image, kind, **more), upright_mask(draw), False)


def alpha(name: str, draw: Draw) -> BadInput:
    """Cut out: the opaque part is the mask, and no file is needed beside."""
    mask = Image.open(io.BytesIO(upright_mask(draw)))
    image = scene(draw)
    kind, grey = (("PNG", False), ("PNG", True), ("WEBP", False), ("TIFF", False))[int(draw.integers(4))]
    image = (image.convert("L") if grey else image).copy()
    image.putalpha(mask)
    return BadInput(f"{name}.{basic.suffix(kind)}", encoded(image, kind), None, False)


def turned(name: str, draw: Draw) -> BadInput:
    """EXIF says how it was held; the mask is upright, or stored as the photograph is."""
    exif = Image.Exif()
    exif[ORIENTATION] = orientation = int(draw.integers(2, 9))
    mask = upright_mask(draw)
    image = scene(draw)
    if orientation >= 5 and draw.integers(2):  # stored lying: upright it is WIDTH x HEIGHT
        image = image.transpose(Image.Transpose.TRANSPOSE)
    kind = ("JPEG", "PNG", "WEBP", "TIFF")[int(draw.integers(4))]
    return BadInput(f"{name}.{basic.suffix(kind)}", encoded(image, kind, exif=exif), mask, False)


def animated(name: str, draw: Draw) -> BadInput:
    """A whole film: its first picture counts."""
    kind = ("GIF", "WEBP", "PNG", "TIFF")[int(draw.integers(4))]
    frames = [scene(draw) for _ in range(int(draw.integers(2, 8)))]
    content = encoded(frames[0], kind, save_all=True, append_images=frames[1:])
    return BadInput(f"{name}.{basic.suffix(kind)}", content, upright_mask(draw), False)


def thin(name: str, draw: Draw) -> BadInput:
    """1 x 1, 1 x 20000, 20000 x 1, and long strips with a mask."""
    size = [(1, 1), (1, 20000), (20000, 1), (2, 2), (16, 20000), (20000, 16)][int(draw.integers(6))]
    kind = ("PNG", "JPEG", "TIFF")[int(draw.integers(3))]
    full = encoded(Image.new("L", size, 255), "PNG")
    image = Image.fromarray(draw.integers(0, 255, (size[1], size[0], 3), dtype=np.uint8))
    return BadInput(f"{name}.{basic.suffix(kind)}", encoded(image, kind), full, True)


def cut_short(name: str, draw: Draw) -> BadInput:
    """The last bytes of a download are missing; mask and name are in order."""
    kind = ("JPEG", "PNG", "WEBP", "TIFF")[int(draw.integers(4))]
    whole = encoded(scene(draw), kind)
    return BadInput(f"{name}.{basic.suffix(kind)}", whole[: -int(draw.integers(1, 60))], upright_mask(draw), None)


def flipped_bits(name: str, draw: Draw) -> BadInput:
    """A few bits of a good file with a good mask are flipped."""
    kind = ("JPEG", "PNG", "WEBP", "TIFF", "BMP", "GIF")[int(draw.integers(6))]
    content = bytearray(encoded(scene(draw), kind))
    for place in draw.integers(0, len(content), int(draw.integers(1, 6))):
        content[place] ^= 1 << int(draw.integers(8))
    return BadInput(f"{name}.{basic.suffix(kind)}", bytes(content), upright_mask(draw), None)


def odd_name(name: str, draw: Draw) -> BadInput:
    """Good pictures whose names hold no UTF-8, line ends, quotes, percent signs, blanks or 200 letters."""
    odd = [
        b"\xff\xfe", b"caf\xe9", b"new\nline", b"tab\tname", b"quote'\"", b"100%25", b" blank ", b"-rf", b"$(id)", b"a" * 200,
        "zèbre".encode(), "斑马".encode(), "\u202egpj".encode(), "e\u0301".encode(), b"semi;colon", b"back\\slash", b"*?[x]",
    ]  # fmt: skip
    stem = os.fsdecode(name.encode() + b"-" + odd[int(draw.integers(len(odd)))])
    return BadInput(f"{stem}.png", encoded(scene(draw), "PNG"), upright_mask(draw), False)


def no_mask(name: str, draw: Draw) -> BadInput:
    """A good photograph for which no mask was given."""
    return BadInput(f"{name}.jpg", encoded(scene(draw), "JPEG"), None, True)


def blurred(name: str, draw: Draw) -> BadInput:
    """Out of focus beyond use."""
    ramp = np.linspace(60, 180, WIDTH)[None, :, None] * np.linspace(0.6, 1.0, HEIGHT)[:, None, None]
    image = Image.fromarray(np.broadcast_to(ramp * [1.0, 0.8, 0.5], (HEIGHT, WIDTH, 3)).astype(np.uint8))
    return BadInput(f"{name}.png", encoded(image, "PNG"), upright_mask(draw), True)


MORE: dict[str, Callable[[str, Draw], BadInput]] = {
    "good": good, "cmyk": cmyk, "sixteen": sixteen, "palette": palette, "alpha": alpha, "turned": turned, "film": animated,
    "thin": thin, "cut-short": cut_short, "flipped-bits": flipped_bits, "odd-name": odd_name, "no-mask": no_mask, "blurred": blurred,
}  # fmt: skip
MAKERS: dict[str, Callable[[str, Draw], BadInput]] = {**basic.MAKERS, **MORE}

REMASKED = frozenset(
    {"truncated", "flipped", "flipped-head", "suffix", "chunk-bomb", "animated", "odd-pixels", "odd-notes"}
)
"""Basic makers whose pictures get a mask, so that they are used if they can be read."""


def damaged(numbers: range = range(COUNT)) -> Iterator[Damaged]:
    """The files of these numbers."""
    makers = list(MAKERS.items())
    for number in numbers:
        kind, maker = makers[number % len(makers)]
        made = maker(f"{number:04d}-{kind}", np.random.default_rng([2024, number]))
        mask = made.mask if kind not in REMASKED else upright_mask(np.random.default_rng([2025, number]))
        yield Damaged(number, kind, made.name, made.content, mask, _usable(made, kind))


def _usable(made: BadInput, kind: str) -> bool | None:
    """What a reconstruction takes may be filtered from a training set, so of most basic makers only refusals are certain."""
    if kind in MORE or kind == "suffix":
        return None if made.refused is None else not made.refused
    return False if made.refused else None


def put(folder: Path, files: Iterator[Damaged]) -> list[Damaged]:
    """Write the files, masks beside them; those whose names the file system refuses are left out."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for each in files:
        try:
            (folder / each.name).write_bytes(each.content)
            if each.mask is not None:
                (folder / f"{Path(each.name).stem}_mask.png").write_bytes(each.mask)
        except (OSError, UnicodeEncodeError):
            continue
        written.append(each)
    return written


def verdicts(files: list[Damaged], folder: Path) -> dict[int, str]:
    """What preparation says about each file that lies in ``folder/pile/animal``: ``used``, or its reasons joined by ``+``.

    Each photograph goes through the steps alone, so that a verdict depends on its file only. No segmenter is asked.
    """
    settings, workspace = preparation(folder)
    steps = [build_step(name, settings, workspace) for name in ("scan", "mask", "crop", "filter")]
    listed = {rows[0].source: rows for rows in open_source(settings, workspace).photos()}
    found = {}
    for each in files:
        rows = listed[text_of_path(Path("animal") / each.name)]
        for step in steps:
            rows = step(rows)
        used = any(row.ok for row in rows)
        found[each.number] = "used" if used else "+".join(sorted({word for row in rows for word in row.reasons}))
    return found


def preparation(folder: Path) -> tuple[Settings, Workspace]:
    """Settings and folders of a run over ``folder/pile``."""
    settings = prepare_settings(["mask.segmenter=none", "features.encoder=null"])
    return settings, Workspace(folder / "pile", folder / "set", folder / "set.work")


def read_verdicts() -> tuple[str, dict[int, str]]:
    """The committed table: the version of Pillow it was made with, and the verdict by number."""
    with TABLE.open(encoding="utf-8", newline="") as handle:
        version = handle.readline().removeprefix("# Pillow ").strip()
        return version, {int(line["number"]): line["verdict"] for line in csv.DictReader(handle, delimiter="\t")}


def complaints(files: list[Damaged], found: dict[int, str]) -> list[str]:
    """Verdicts that are not those of the table, and files that were used or skipped although they may not be.

    Damaged files are decoded by libraries that differ between versions of Pillow: the table holds for the version it names, and for
    another only what is certain does.
    """
    version, table = read_verdicts()
    told = []
    for each in files:
        verdict = found[each.number]
        if each.usable is not None and each.usable != (verdict == "used"):
            told.append(f"{each.number} {each.kind}: expected {'use' if each.usable else 'a reason'}, got {verdict}")
        if any(word.split(":")[-1] not in REASONS for word in verdict.split("+")) and verdict != "used":
            told.append(f"{each.number} {each.kind}: {verdict} is no reason")
        if version == PIL.__version__ and table[each.number] != verdict:
            told.append(f"{each.number} {each.kind}: expected {table[each.number]}, got {verdict}")
    return told


def main() -> None:
    """Prepare all files twice, by the steps and by the command; print what was found, complaints and the largest memory."""
    parser = argparse.ArgumentParser(description="fauna-prepare over damaged and odd files.")
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--write", action="store_true", help="write the table of verdicts anew")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as root:
        folder = Path(root)
        files = put(folder / "pile" / "animal", damaged(range(given.count)))
        found = verdicts(files, folder)
        shutil.rmtree(folder / "set.work")
        again = verdicts(files, folder)
        shutil.rmtree(folder / "set.work")
        if given.write:
            lines = [f"{each.number}\t{each.kind}\t{found[each.number]}\n" for each in files]
            TABLE.write_text(f"# Pillow {PIL.__version__}\nnumber\tkind\tverdict\n" + "".join(lines), encoding="utf-8")
        told = complaints(files, found)
        told += [
            f"{number}: {found[number]} first, {again[number]} again"
            for number in found
            if found[number] != again[number]
        ]
        code, said = run_command(folder)
        rows = [row for file in manifest_files(folder / "set") for row in read_table(file)]
    told += [said] if "Traceback" in said or code else []
    told += (
        [] if {row.source for row in rows} == {text_of_path(Path("animal") / each.name) for each in files} else ["rows"]
    )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 if sys.platform == "darwin" else 1024)
    print(f"{len(files)} files, by the steps: {dict(Counter(found.values()).most_common())}")
    print(
        f"command: exit code {code}, {len(rows)} rows, {dict(Counter(row.status for row in rows))}; largest memory {peak:.0f} MiB"
    )
    print(*(told or ["no complaints"]), sep="\n")
    sys.exit(1 if told or code else 0)


def run_command(folder: Path) -> tuple[int, str]:
    """Exit code and output of ``fauna-prepare all`` over the pile, in a process of its own."""
    words = [str(folder / "pile"), str(folder / "set"), "mask.segmenter=none", "features.encoder=null"]
    done = subprocess.run(
        [sys.executable, "-m", "fauna.prepare.command", "all", *words], capture_output=True, text=True, errors="replace"
    )
    return done.returncode, done.stdout + done.stderr


if __name__ == "__main__":
    main()
