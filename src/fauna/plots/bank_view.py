"""``bank.png``: what the bank saw in one photograph, as pictures."""

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw
from torch import Tensor

from fauna.bank.view import BankView, Neighbour
from fauna.data.sources import ZooSource
from fauna.model import FaunaModel
from fauna.plots.bodies import INK, LINE, PAPER, Look, body_views, sheet, stacked, tile
from fauna.reconstruct.traits import embody, resting

BAR = ((90, 130, 70), (190, 120, 60))
"""Colours of positive and negative cosines."""
BARS = 12
"""Species with a bar."""


def draw_view(
    model: FaunaModel,
    view: BankView,
    code: Float[Tensor, " value_chan"],
    crop: UInt8[np.ndarray, "size size 3"],
    *,
    slots: int,
    cell: int,
) -> Image.Image:
    """The photograph and its base shape; the slots that make it; species, and the nearest training pictures.

    Pictures of the zoo are drawn again (and kept in the cache); of those that came from files only the name is known.

    Args:
        model: whose bank it is.
        view: of the photograph.
        code: of the photograph.
        crop: of the photograph.
        slots: with a picture.
        cell: side of a picture, pixels.
    """
    values = model.bank.get_parameter("values").detach()
    photo = np.asarray(Image.fromarray(crop).resize((cell, cell), Image.Resampling.LANCZOS))
    own = [tile([photo], "photograph\n"), tile(_shape(model, code, cell), "base shape of the answer\n")]
    if view.species is not None:
        own.append(_bars(view.species[:BARS], cell))
    used = [
        tile(
            _shape(model, values[each.slot], cell),
            f"slot {each.slot}, weight {each.weight:.2f}\n{_named(each.species)}",
        )
        for each in view.slots[:slots]
    ]
    sheets = [("", sheet(own, columns=len(own))), ("slots, alone", sheet(used, columns=3))]
    if view.pictures:
        found = [tile([_picture(each, cell)], f"{each.name}\n{each.similarity:.2f}") for each in view.pictures]
        sheets.append(("training pictures with the nearest shape codes", sheet(found, columns=len(found))))
    return stacked(sheets)


def _shape(model: FaunaModel, code: Float[Tensor, " value_chan"], cell: int) -> list[np.ndarray]:
    with torch.no_grad():
        base = embody(model, resting(code)).base
    return body_views(Look(base.verts, base.faces), views=2, size=cell)


def _named(species: tuple[tuple[str, float], ...]) -> str:
    return ", ".join(f"{name} {share:.0%}" for name, share in species)


def _bars(species: tuple[tuple[str, float], ...], cell: int) -> Image.Image:
    """Cosines as bars."""
    picture = Image.new("RGB", (2 * cell, cell + 2 * LINE), PAPER)
    pen = ImageDraw.Draw(picture)
    pen.text((2, 0), "cosine with the mean code of a species", fill=INK)
    step = (cell + LINE) / max(len(species), 1)
    for place, (name, value) in enumerate(species):
        top = LINE + place * step
        pen.text((2, top - 1), f"{name} {value:.2f}", fill=INK)
        length = abs(value) * (cell - 8)
        pen.rectangle([cell, top + 1, cell + length, top + step - 2], fill=BAR[value < 0])
    return picture


def _picture(neighbour: Neighbour, cell: int) -> UInt8[np.ndarray, "cell cell 3"]:
    """The training picture, drawn again; a grey square where it came from a file."""
    drawing = neighbour.drawing
    if drawing is None:
        return np.full((cell, cell, 3), 225, np.uint8)
    source = ZooSource(drawing.seed, drawing.image_size, drawing.species, drawing.number)
    return np.asarray(Image.fromarray(source.read().image).resize((cell, cell), Image.Resampling.LANCZOS))
