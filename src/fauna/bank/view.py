"""What a bank saw in one photograph: slots, what they stand for, species it resembles, training pictures nearest to it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from torch import Tensor

from fauna.bank.table import BankTable, Drawing, similarity
from fauna.types import BankReadout


@dataclass(frozen=True)
class SlotUse:
    """A slot of an answer.

    Attributes:
        slot: its number.
        weight: in the answer, signed.
        species: for which the bank uses it, with the share of all its use, largest first; none without a table.
    """

    slot: int
    weight: float
    species: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Neighbour:
    """A training picture.

    Attributes:
        name: as the dataset calls it.
        species: that it shows.
        similarity: cosine of the shape codes, in [-1, 1].
        drawing: how it is drawn again, ``None`` for pictures of files.
    """

    name: str
    species: str
    similarity: float
    drawing: Drawing | None


@dataclass(frozen=True, eq=False)
class BankView:
    """An answer, explained.

    Attributes:
        slots: most important first.
        species: cosine of the photograph's shape code and the mean code of each species, most similar first; ``None`` without a table.
        pictures: nearest training pictures, most similar first; ``None`` without a table. Where the zoo drew some, of these only: they
            can be shown.
    """

    slots: tuple[SlotUse, ...]
    species: tuple[tuple[str, float], ...] | None
    pictures: tuple[Neighbour, ...] | None


def view_of(
    readout: BankReadout,
    values: Float[Tensor, "slot value_chan"],
    table: BankTable | None,
    *,
    species: int,
    pictures: int,
) -> BankView:
    """Explain the answer to the first photograph of a batch.

    Similarity is that of shape codes, of what the bank makes of a picture: animals that get the same body are neighbours.

    Args:
        readout: of a bank with slots.
        values: of the bank's slots.
        table: of the same weights; ``None`` leaves all names out.
        species: named for each slot.
        pictures: neighbours.
    """
    assert readout.slots is not None, "only for banks with slots"
    assert readout.weights is not None, "likewise"
    answer = zip(readout.slots[0].tolist(), readout.weights[0].tolist(), strict=True)
    order = sorted(answer, key=lambda pair: (-abs(pair[1]), pair[0]))
    if table is None:
        return BankView(tuple(SlotUse(slot, weight, ()) for slot, weight in order), None, None)
    code = readout.embedding[:1].detach().double().cpu().numpy()
    likeness = similarity(code, table.species_codes(values))[0]
    shares = _shares(table, len(values))
    slots = tuple(SlotUse(slot, weight, _top(table.kinds, shares[:, slot], species)) for slot, weight in order)
    return BankView(slots, _top(table.kinds, likeness, len(table.kinds)), _neighbours(table, code, values, pictures))


def _shares(table: BankTable, num_slots: int) -> Float[np.ndarray, "kind slot"]:
    """How much of a slot's use falls on each species, all species counted alike; columns add up to 1."""
    usage = table.usage(num_slots)
    return usage / np.maximum(usage.sum(axis=0, keepdims=True), 1e-12)


def _top(names: tuple[str, ...], values: Float[np.ndarray, " name"], most: int) -> tuple[tuple[str, float], ...]:
    order = np.argsort(-values, kind="stable")[:most]
    return tuple((names[place], float(values[place])) for place in order)


def _neighbours(
    table: BankTable, code: Float[np.ndarray, "1 value_chan"], values: Tensor, most: int
) -> tuple[Neighbour, ...]:
    """Training pictures with the nearest codes, of those that can be drawn again where there are any."""
    trained = np.flatnonzero(table.trained)
    drawn = np.array([place for place in trained.tolist() if table.drawing(place) is not None], dtype=np.int64)
    trained = drawn if len(drawn) else trained
    likeness = similarity(code, table.codes(values)[trained])[0]
    nearest = trained[np.argsort(-likeness, kind="stable")[:most]]
    best = np.sort(likeness)[::-1][:most]
    return tuple(
        Neighbour(table.names[place], table.species[place], float(value), table.drawing(place))
        for place, value in zip(nearest.tolist(), best.tolist(), strict=True)
    )
