"""Small pictures of bodies, and sheets of them with captions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from PIL import Image, ImageDraw
from torch import Tensor

from fauna.renderer.numba_backend import NumbaRenderer
from fauna.viewer.studio import CLAY, Paint, Turntable, draw

Picture = UInt8[np.ndarray, "height width 3"]
LINE, GAP = 14, 6
"""Height of a line of text and width of a gap, pixels."""
INK, PAPER = (40, 40, 40), (255, 255, 255)


@dataclass(frozen=True, eq=False)
class Look:
    """A surface as it is drawn.

    Attributes:
        verts: (vert, 3) y up, head at +z, any unit.
        faces: (face, 3) counter-clockwise seen from outside.
        colours: (vert, 3) sRGB in [0, 1]; ``None`` is clay.
    """

    verts: Float[Tensor, "vert 3"]
    faces: Int[Tensor, "face 3"]
    colours: Float[Tensor, "vert 3"] | None = None

    def grounded(self) -> "Look":
        """The same with its lowest vertex at y = 0."""
        down = torch.zeros_like(self.verts[:1])
        down[0, 1] = self.verts[:, 1].min()
        return replace(self, verts=self.verts - down)


@torch.no_grad()
def photographed(looks: Sequence[Look], *, size: int, turn: bool) -> list[UInt8[np.ndarray, "size size 3"]]:
    """Surfaces one after the other, all from the distance at which every one of them fits.

    Args:
        looks: at least one.
        size: side of a picture, pixels.
        turn: go once around while they pass; otherwise all show their left side, half turned to the camera.
    """
    longest = max(len(each.verts) for each in looks)
    stack = torch.stack([_padded(each.verts.detach().float().cpu(), longest) for each in looks])
    table = Turntable.around(stack)
    if not turn:
        table = replace(table, camera=table.camera.rows(torch.zeros(len(looks), dtype=torch.int64)))
    renderer = NumbaRenderer()
    return [
        draw(renderer, stack, each.faces.cpu(), _paint(each, longest), table, frame, size=size)
        for frame, each in enumerate(looks)
    ]


def body_views(look: Look, *, views: int, size: int) -> list[UInt8[np.ndarray, "size size 3"]]:
    """A body from several sides, evenly around it; the first shows its left side, half turned to the camera.

    Args:
        look: one.
        views: how many.
        size: side of a picture, pixels.
    """
    return photographed([look] * views, size=size, turn=True)


def tile(pictures: Sequence[Picture], caption: str) -> Image.Image:
    """Pictures of one height side by side under a caption, which is cut where it is longer than they are."""
    strip = Image.fromarray(np.concatenate(list(pictures), axis=1))
    whole = Image.new("RGB", (strip.width, strip.height + LINE * (caption.count("\n") + 1)), PAPER)
    whole.paste(strip, (0, whole.height - strip.height))
    ImageDraw.Draw(whole).text((2, 0), caption, fill=INK)
    return whole


def sheet(tiles: Sequence[Image.Image], *, columns: int) -> Image.Image:
    """Tiles in rows, from left to right.

    Args:
        tiles: at least one, of any sizes.
        columns: tiles of a row.
    """
    rows = [tiles[start : start + columns] for start in range(0, len(tiles), columns)]
    heights = [max(each.height for each in row) for row in rows]
    width = max(sum(each.width + GAP for each in row) - GAP for row in rows)
    whole = Image.new("RGB", (width, sum(heights) + GAP * (len(rows) - 1)), PAPER)
    top = 0
    for row, height in zip(rows, heights, strict=True):
        left = 0
        for each in row:
            whole.paste(each, (left, top + height - each.height))
            left += each.width + GAP
        top += height + GAP
    return whole


def stacked(sheets: Sequence[tuple[str, Image.Image]]) -> Image.Image:
    """Sheets below each other, each under its title."""
    width = max(each.width for _, each in sheets)
    whole = Image.new("RGB", (width, sum(each.height + LINE + 2 * GAP for _, each in sheets)), PAPER)
    pen, top = ImageDraw.Draw(whole), 0
    for title, each in sheets:
        pen.text((2, top + 2), title, fill=INK)
        whole.paste(each, (0, top + LINE + GAP))
        top += each.height + LINE + 2 * GAP
    return whole


def _padded(verts: Float[Tensor, "vert 3"], longest: int) -> Float[Tensor, "{longest} 3"]:
    """With its first vertex repeated, which belongs to no face and changes no bounding box."""
    return torch.cat([verts, verts[:1].expand(longest - len(verts), -1)])


def _paint(look: Look, longest: int) -> Paint:
    clay = torch.tensor(CLAY).expand(len(look.verts), 3)
    return Paint(_padded(clay if look.colours is None else look.colours.float().cpu(), longest), None, None)
