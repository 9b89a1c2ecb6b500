"""Pictures with a mask in which there is no four-legged animal: drawn ones, and pieces of photographs beside the animal."""

import math
from collections.abc import Callable, Iterator

import numpy as np
from PIL import Image, ImageDraw
from scipy.ndimage import distance_transform_cdt

Pair = tuple[np.ndarray, np.ndarray]
"""Photograph (height, width, 3) of 8 bits, and mask (height, width)."""
SIDE = 256
MAX_TILT_DEG = 15.0
LEAST_WINDOW = 64
"""Pixels: smaller pieces of a photograph are no pictures."""

Pen = ImageDraw.ImageDraw


def _boxes(pen: Pen, *boxes: tuple[float, float, float, float]) -> None:
    for box in boxes:
        pen.rectangle(box, fill=255)


def _rounds(pen: Pen, *boxes: tuple[float, float, float, float]) -> None:
    for box in boxes:
        pen.ellipse(box, fill=255)


def _star(pen: Pen) -> None:
    corners = [(100 if corner % 2 == 0 else 40, corner * math.pi / 5) for corner in range(10)]
    pen.polygon([(128 + far * math.sin(turn), 128 - far * math.cos(turn)) for far, turn in corners], fill=255)


def _person(pen: Pen) -> None:
    _rounds(pen, (108, 20, 148, 60))
    _boxes(pen, (98, 60, 158, 150), (98, 150, 122, 240), (134, 150, 158, 240), (60, 62, 98, 82), (158, 62, 196, 82))


def _car(pen: Pen) -> None:
    _boxes(pen, (30, 120, 226, 170))
    pen.polygon([(70, 120), (100, 80), (170, 80), (200, 120)], fill=255)
    _rounds(pen, (55, 150, 95, 190), (165, 150, 205, 190))


def _bird(pen: Pen) -> None:
    _rounds(pen, (70, 90, 180, 150), (165, 60, 205, 100))
    pen.polygon([(70, 120), (20, 140), (75, 140)], fill=255)
    _boxes(pen, (120, 145, 126, 200), (140, 145, 146, 200))


def _fish(pen: Pen) -> None:
    _rounds(pen, (40, 90, 190, 170))
    pen.polygon([(185, 130), (235, 90), (235, 170)], fill=255)


def _tree(pen: Pen) -> None:
    _boxes(pen, (118, 140, 138, 240))
    _rounds(pen, (50, 20, 206, 160))


def _snake(pen: Pen) -> None:
    pen.line([(20 + 4 * step, 128 + 50 * math.sin(step / 7)) for step in range(54)], fill=255, width=16)


THINGS: dict[str, Callable[[Pen], None]] = {
    "disc": lambda pen: _rounds(pen, (50, 50, 206, 206)),
    "ellipse": lambda pen: _rounds(pen, (30, 90, 226, 170)),
    "box": lambda pen: _boxes(pen, (60, 80, 200, 190)),
    "bar": lambda pen: _boxes(pen, (110, 20, 140, 236)),
    "star": _star,
    "person": _person,
    "table": lambda pen: _boxes(pen, (30, 90, 226, 110), *((x, 110, x + 12, 210) for x in (35, 80, 165, 208))),
    "chair": lambda pen: _boxes(pen, (70, 20, 84, 220), (70, 120, 180, 136), (168, 120, 180, 220)),
    "car": _car,
    "bird": _bird,
    "fish": _fish,
    "snake": _snake,
    "tree": _tree,
}


def outline(number: int, draw: np.random.Generator) -> np.ndarray:
    """The mask of a thing, (SIDE, SIDE): one of :data:`THINGS`, tilted, or after each round of them a blob."""
    kind = number % (len(THINGS) + 1)
    if kind == len(THINGS):
        lattice = Image.fromarray(draw.normal(size=(9, 9)).astype(np.float32))
        return np.asarray(lattice.resize((SIDE, SIDE), Image.Resampling.BICUBIC)) > 0.7
    picture = Image.new("L", (SIDE, SIDE))
    list(THINGS.values())[kind](ImageDraw.Draw(picture))
    return np.asarray(picture.rotate(float(draw.uniform(-MAX_TILT_DEG, MAX_TILT_DEG)))) > 127


def drawn_things(count: int, seed: int) -> Iterator[Pair]:
    """Things in one random texture before another."""
    draw = np.random.default_rng(seed)
    for number in range(count):
        mask = outline(number, draw)
        yield np.where(mask[..., None], _texture(draw), _texture(draw)), mask


def pieces(pairs: Iterator[Pair], seed: int) -> Iterator[Pair]:
    """From every photograph the largest square beside its animal, with the outline of a thing; none where too small."""
    draw = np.random.default_rng(seed)
    for number, (image, mask) in enumerate(pairs):
        window = _free_square(mask)
        mark = outline(number, draw)
        if window is not None:
            piece = Image.fromarray(image[window]).resize((SIDE, SIDE), Image.Resampling.BICUBIC)
            yield np.array(piece), mark


def _free_square(mask: np.ndarray) -> tuple[slice, slice] | None:
    """The largest square without animal."""
    free = distance_transform_cdt(np.pad(~mask, 1), metric="chessboard")[1:-1, 1:-1]  # to the animal or the border
    row, column = np.unravel_index(int(free.argmax()), free.shape)
    reach = int(free[row, column]) - 1
    if 2 * reach + 1 < LEAST_WINDOW:
        return None
    return slice(row - reach, row + reach + 1), slice(column - reach, column + reach + 1)


def _texture(draw: np.random.Generator) -> np.ndarray:
    """A colour with soft spots of one size."""
    cells = max(SIDE // int(draw.integers(2, 40)), 2)
    spots = Image.fromarray(draw.integers(0, 255, (cells, cells, 3), dtype=np.uint8))
    spots = np.asarray(spots.resize((SIDE, SIDE), Image.Resampling.BILINEAR))
    return (0.4 * spots + 0.6 * draw.integers(0, 255, 3)).astype(np.uint8)
