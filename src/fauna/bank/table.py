"""What the bank answered to known pictures: the side file that tells which species a slot stands for.

Slots have no labels: a bank never hears a species' name. Names come afterwards, from the answers to pictures whose species is known.
A table holds these answers, sparse, and belongs to exactly one weight file, whose SHA-256 it carries.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from safetensors import SafetensorError, safe_open
from torch import Tensor

from fauna.errors import FaunaError
from fauna.io.checkpoint import safetensors_bytes

TABLE = "bank.safetensors"
"""Name of the table beside its weight file."""
FORMAT = "fauna-bank-1"


@dataclass(frozen=True)
class Drawing:
    """A picture of the zoo, drawn again when somebody wants to see it.

    Attributes:
        seed: of :class:`fauna.zoo.Zoo`.
        image_size: likewise.
        species: that it shows.
        number: of the picture within its species.
    """

    seed: int
    image_size: int
    species: str
    number: int


@dataclass(frozen=True)
class DrawnBy:
    """The zoo whose pictures a table lists.

    Attributes:
        seed: of :class:`fauna.zoo.Zoo`.
        image_size: likewise.
    """

    seed: int
    image_size: int


@dataclass(frozen=True, eq=False)
class BankTable:
    """Answers of one bank to many pictures.

    Attributes:
        weights_sha256: of the weight file that answered.
        names: of the pictures, ``<species>/<number>`` for those of the zoo.
        species: of each picture.
        trained: whether the weights learned from it.
        slots: that each picture was made of.
        weights: of these slots; absolute values add up to 1.
        zoo: that drew the pictures of :meth:`drawing`, ``None`` when there are none.
    """

    weights_sha256: str
    names: tuple[str, ...]
    species: tuple[str, ...]
    trained: Bool[np.ndarray, " picture"]
    slots: Int[np.ndarray, "picture slot"]
    weights: Float[np.ndarray, "picture slot"]
    zoo: DrawnBy | None

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Every species once, by name."""
        return tuple(sorted(set(self.species)))

    @cached_property
    def members(self) -> Bool[np.ndarray, "kind picture"]:
        """Which pictures show a species of :attr:`kinds`."""
        return np.array(self.kinds)[:, None] == np.array(self.species)[None]

    def is_trained(self, kind: str) -> bool:
        """Whether the weights learned from pictures of a species."""
        return bool(self.trained[self.members[self.kinds.index(kind)]].any())

    def usage(self, num_slots: int) -> Float[np.ndarray, "kind {num_slots}"]:
        """Mean absolute weight of every slot in the pictures of each species; rows add up to 1."""
        dense = np.zeros((len(self.names), num_slots))
        np.put_along_axis(dense, self.slots, np.abs(self.weights), axis=1)
        return _means(self.members, dense)

    def codes(self, values: Float[Tensor, "slot value_chan"]) -> Float[np.ndarray, "picture value_chan"]:
        """Shape codes of the pictures.

        Args:
            values: of the bank that answered.
        """
        table = values.detach().double().cpu().numpy()
        return np.einsum("ps,psc->pc", self.weights, table[self.slots])

    def species_codes(self, values: Float[Tensor, "slot value_chan"]) -> Float[np.ndarray, "kind value_chan"]:
        """Mean shape code of each species.

        Args:
            values: of the bank that answered.
        """
        return _means(self.members, self.codes(values))

    def drawing(self, picture: int) -> Drawing | None:
        """How a picture is drawn again, ``None`` for pictures of files."""
        kind, _, number = self.names[picture].partition("/")
        if self.zoo is None or not number.isdigit():
            return None
        return Drawing(self.zoo.seed, self.zoo.image_size, kind, int(number))


def similarity(
    first: Float[np.ndarray, "one chan"], second: Float[np.ndarray, "other chan"]
) -> Float[np.ndarray, "one other"]:
    """Cosines of rows, in [-1, 1]."""
    a, b = (each / np.maximum(np.linalg.norm(each, axis=1, keepdims=True), 1e-12) for each in (first, second))
    return (a @ b.T).clip(-1.0, 1.0)


def write_table(table: BankTable, path: Path) -> None:
    """Write a table; equal tables give equal bytes."""
    kinds = table.kinds
    tensors = {
        "slots": torch.from_numpy(table.slots.astype(np.int16)),
        "weights": torch.from_numpy(table.weights.astype(np.float16)),
        "species": torch.tensor([kinds.index(each) for each in table.species], dtype=torch.int16),
        "trained": torch.from_numpy(table.trained.astype(np.uint8)),
    }
    facts = {
        "format": FORMAT,
        "weights_sha256": table.weights_sha256,
        "kinds": json.dumps(kinds),
        "names": json.dumps(table.names),
        "zoo": json.dumps(None if table.zoo is None else [table.zoo.seed, table.zoo.image_size]),
    }
    partial = path.with_suffix(".partial")
    partial.write_bytes(safetensors_bytes(tensors, facts))
    partial.replace(path)


def read_table(path: Path) -> BankTable:
    """Read a table.

    Raises:
        FaunaError: when the file is missing, damaged, or none.
    """
    try:
        with safe_open(path, framework="np") as handle:
            facts = handle.metadata() or {}
            arrays = {name: handle.get_tensor(name) for name in ("slots", "weights", "species", "trained")}
        kinds, zoo = json.loads(facts["kinds"]), json.loads(facts["zoo"])
        if facts["format"] != FORMAT:
            raise ValueError(f"format {facts['format']}")
        return BankTable(
            facts["weights_sha256"],
            tuple(json.loads(facts["names"])),
            tuple(kinds[each] for each in arrays["species"].tolist()),
            arrays["trained"] > 0,
            arrays["slots"].astype(np.int64),
            arrays["weights"].astype(np.float64),
            None if zoo is None else DrawnBy(*zoo),
        )
    except (SafetensorError, OSError, KeyError, ValueError, TypeError, IndexError) as error:
        raise FaunaError(
            f"bank table: expected a file of fauna-bank table, got {path} ({type(error).__name__}); make it anew"
        ) from error


def table_beside(weights: Path, sha256: str) -> BankTable | None:
    """The table of a weight file; ``None`` when none lies beside it, or one of other weights.

    Args:
        weights: weight file or checkpoint.
        sha256: of it.

    Raises:
        FaunaError: when the table is damaged.
    """
    path = weights.parent / TABLE
    if not path.is_file():
        return None
    table = read_table(path)
    return table if table.weights_sha256 == sha256 else None


def _means(members: Bool[np.ndarray, "kind picture"], rows: Float[np.ndarray, "picture chan"]) -> np.ndarray:
    return (members @ rows) / members.sum(axis=1, keepdims=True)


def joined(answers: Sequence[tuple[Tensor, Tensor]]) -> tuple[Int[np.ndarray, "picture slot"], np.ndarray]:
    """Slots and weights of many batches as arrays."""
    slots, weights = zip(*answers, strict=True)
    return torch.cat(slots).cpu().numpy(), torch.cat(weights).double().cpu().numpy()
