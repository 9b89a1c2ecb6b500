"""Pictures of what a bank has learned, from any weights and the answers to any pictures of known species.

``fauna-bank species`` writes all four. They need a :class:`~fauna.bank.table.BankTable`, which is read from beside the weights or made
by :func:`fauna.bank.census.take_census`.
"""

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.figure import Figure
from PIL import Image
from scipy.cluster.hierarchy import leaves_list, linkage
from torch import Tensor

from fauna.bank.samples import slot_values
from fauna.bank.table import BankTable, similarity
from fauna.errors import FaunaError
from fauna.io.contact_sheet import save_png
from fauna.model import FaunaModel
from fauna.plots.bodies import Look, body_views, photographed, sheet, tile
from fauna.reconstruct.traits import embody, resting

CELL = 128
"""Side of a body's picture, pixels."""
STEPS = 7
"""Bodies between two species, both counted."""
UNSEEN = "*"
"""Behind the names of species that the weights did not learn from."""
NOTE = f"{UNSEEN} not among the species that the weights learned from"


def draw_bank(model: FaunaModel, table: BankTable, folder: Path, *, between: tuple[str, str]) -> list[Path]:
    """Write ``similarity.png``, ``slots.png``, ``slot_shapes.png`` and ``between.png``.

    Args:
        model: with a bank of slots.
        table: its answers.
        folder: where to; it is made.
        between: two species for the last one.

    Raises:
        FaunaError: for a bank without slots, or a species that the table does not have.
    """
    _check(table, between)
    values = slot_values(model)
    pictures = {
        "similarity": similarity_picture(table, values),
        "slots": slots_picture(table, len(values)),
        "slot_shapes": slot_shapes(model, table),
        "between": between_species(model, table, between),
    }
    for name, picture in pictures.items():
        save_png(picture, folder / f"{name}.png")
    return [folder / f"{name}.png" for name in pictures]


def species_similarity(table: BankTable, values: Float[Tensor, "slot value_chan"]) -> Float[np.ndarray, "kind kind"]:
    """Cosines between the mean shape codes of the species, in the order of ``table.kinds``."""
    codes = table.species_codes(values)
    return similarity(codes, codes)


def similarity_picture(table: BankTable, values: Float[Tensor, "slot value_chan"]) -> Image.Image:
    """Two matrices: cosines between mean shape codes, and between mean slot weights; species ordered so that like ones are neighbours."""
    usage = table.usage(len(values))
    matrices = {
        "cosine of mean shape codes": species_similarity(table, values),
        "cosine of mean slot weights": similarity(usage, usage),
    }
    order = _order(table.species_codes(values))
    names = [_title(table, table.kinds[place]) for place in order]
    side = 1.6 + 0.26 * len(names)
    figure = Figure(figsize=(2 * side, side), dpi=100, layout="constrained")
    for axes, (title, matrix) in zip(figure.subplots(1, 2), matrices.items(), strict=True):
        low = -1.0 if matrix.min() < 0 else 0.0
        image = axes.imshow(matrix[np.ix_(order, order)], cmap="PuOr" if low else "Purples", vmin=low, vmax=1.0)
        axes.set_xticks(range(len(names)), names, rotation=90, fontsize=8)
        axes.set_yticks(range(len(names)), names, fontsize=8)
        axes.set_title(title, fontsize=9, loc="left")
        figure.colorbar(image, ax=axes, shrink=0.7)
    figure.supxlabel(NOTE, fontsize=8)
    return _image(figure)


def slots_picture(table: BankTable, num_slots: int) -> Image.Image:
    """How much of each slot goes into each species; slots in the order of the species that uses them most."""
    usage = table.usage(num_slots)
    kinds = _order(usage)
    most = usage[kinds].argmax(axis=0)
    slots = sorted(range(num_slots), key=lambda slot: (most[slot], -usage[:, slot].max()))
    figure = Figure(figsize=(1.6 + 0.16 * num_slots, 1.2 + 0.22 * len(kinds)), dpi=100, layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(usage[np.ix_(kinds, slots)], cmap="Greens", aspect="auto", vmin=0.0)
    axes.set_yticks(range(len(kinds)), [_title(table, table.kinds[place]) for place in kinds], fontsize=8)
    axes.set_xticks(range(num_slots), [str(slot) for slot in slots], fontsize=6, rotation=90)
    axes.set_xlabel(f"slot        ({NOTE})", fontsize=8)
    axes.set_title("mean absolute weight of a slot in the pictures of a species", fontsize=9, loc="left")
    figure.colorbar(image, ax=axes)
    return _image(figure)


def slot_shapes(model: FaunaModel, table: BankTable) -> Image.Image:
    """Base shape of every slot alone from two sides, most used first, with the two species that use it most."""
    values = slot_values(model)
    usage = table.usage(len(values))
    shares = usage / np.maximum(usage.sum(axis=0), 1e-12)
    tiles = []
    for slot in np.argsort(-usage.sum(axis=0), kind="stable").tolist():
        first, second = np.argsort(-shares[:, slot], kind="stable")[:2]
        named = f"{table.kinds[first]} {shares[first, slot]:.0%}, {table.kinds[second]} {shares[second, slot]:.0%}"
        pictures = body_views(_look(model, values[slot]), views=2, size=CELL)
        tiles.append(tile(pictures, f"slot {slot}\n{named if usage[:, slot].any() else 'never used'}"))
    return sheet(tiles, columns=6)


def between_species(model: FaunaModel, table: BankTable, names: tuple[str, str]) -> Image.Image:
    """Base shapes between the mean codes of two species, at one scale.

    Raises:
        FaunaError: for a species that the table does not have.
    """
    _check(table, names)
    codes = torch.from_numpy(table.species_codes(slot_values(model))).to(slot_values(model))
    first, second = (codes[table.kinds.index(name)] for name in names)
    shares = np.linspace(0.0, 1.0, STEPS).tolist()
    looks = [_look(model, torch.lerp(first, second, share)).grounded() for share in shares]
    captions = [names[0], *(f"{share:.0%}" for share in shares[1:-1]), names[1]]
    tiles = [
        tile([picture], caption)
        for picture, caption in zip(photographed(looks, size=CELL, turn=False), captions, strict=True)
    ]
    return sheet(tiles, columns=STEPS)


def _check(table: BankTable, names: tuple[str, str]) -> None:
    for name in names:
        if name not in table.kinds:
            raise FaunaError(f"between: expected species of {', '.join(table.kinds)}, got {name!r}; choose another")


def _look(model: FaunaModel, code: Float[Tensor, " value_chan"]) -> Look:
    base = embody(model, resting(code)).base
    return Look(base.verts, base.faces)


def _order(rows: Float[np.ndarray, "kind chan"]) -> list[int]:
    """An order in which like rows are neighbours: the leaves of a tree of average cosine distances."""
    if len(rows) < 3:
        return list(range(len(rows)))
    return leaves_list(linkage(rows, method="average", metric="cosine", optimal_ordering=True)).tolist()


def _title(table: BankTable, kind: str) -> str:
    return kind if table.is_trained(kind) else f"{kind}{UNSEEN}"


def _image(figure: Figure) -> Image.Image:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())
