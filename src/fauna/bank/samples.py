"""Bodies that nobody photographed (supplement of the paper, "Shape Generation from the Semantic Bank")."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from fauna.errors import FaunaError
from fauna.model import FaunaModel
from fauna.random import derive_seed

Kind = Literal["slot", "ten", "all"]
TEN = 10
"""Slots of a mixture of kind ``ten``."""
MOST = 1000
"""Mixtures of a kind."""


@dataclass(frozen=True, eq=False)
class BankSample:
    """A shape code and where it comes from.

    Attributes:
        name: of the body and its file.
        kind: ``slot``: one slot alone; ``ten``, ``all``: a mixture.
        slots: that were mixed.
        weights: of these; not negative, with a sum of 1.
        code: the mixture of their values.
    """

    name: str
    kind: Kind
    slots: tuple[int, ...]
    weights: tuple[float, ...]
    code: Float[Tensor, " value_chan"]


@dataclass(frozen=True, eq=False)
class BankSamples:
    """Samples of one bank.

    Attributes:
        model: whose bank it is.
        weights_sha256: of its weight file.
        seed: of the mixtures.
        samples: every slot, then the mixtures.
    """

    model: FaunaModel
    weights_sha256: str
    seed: int
    samples: Sequence[BankSample]

    def save(self, folder: str | Path) -> Path:
        """Write ``bank.png``, a GLB of every sample and ``result.json`` into a folder, which is made.

        Returns:
            The folder.
        """
        from fauna.bank.sample_files import write_samples

        path = Path(folder).expanduser()
        path.mkdir(parents=True, exist_ok=True)
        write_samples(self, path)
        return path


def sample_bank(model: FaunaModel, weights_sha256: str, *, mixtures: int, seed: int) -> BankSamples:
    """Every slot alone, and mixtures of ten slots and of all of them.

    Weights are uniform over all that are not negative and add up to 1 (a flat Dirichlet distribution). The paper only says "random weights (with a sum of 1)";
    weights drawn evenly from an interval and divided by their sum are all nearly equal when there are 60, and so are the bodies.

    Args:
        model: with a bank of slots.
        weights_sha256: of its weight file.
        mixtures: of each kind.
        seed: of their slots and weights.

    Raises:
        FaunaError: for a bank without slots, or a number out of range.
    """
    values = slot_values(model)
    for name, value, most in (("mixtures", mixtures, MOST), ("seed", seed, 2**32 - 1)):
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
            raise FaunaError(f"{name}: expected a whole number from 0 to {most}, got {value!r}; give another number")
    samples = [BankSample(f"slot_{slot:02d}", "slot", (slot,), (1.0,), value) for slot, value in enumerate(values)]
    kinds: tuple[tuple[Kind, int], ...] = (("ten", min(TEN, len(values))), ("all", len(values)))
    for kind, size in kinds:
        samples += [_mixture(values, kind, size, number, seed) for number in range(mixtures)]
    return BankSamples(model, weights_sha256, seed, tuple(samples))


def slot_values(model: FaunaModel) -> Float[Tensor, "slot value_chan"]:
    """The values of a bank's slots, without gradient.

    Raises:
        FaunaError: for a bank without slots.
    """
    if getattr(model.bank, "keys", None) is None:
        raise FaunaError(
            f"bank: expected a bank with slots, got {type(model.bank).__name__}; use weights with bank=semantic"
        )
    return model.bank.get_parameter("values").detach()


def _mixture(values: Float[Tensor, "slot value_chan"], kind: Kind, size: int, number: int, seed: int) -> BankSample:
    """A function of its seed, kind and number alone: more mixtures do not change the first ones."""
    generator = torch.Generator().manual_seed(derive_seed(seed, "bank", kind, number))
    slots = torch.randperm(len(values), generator=generator)[:size].sort().values
    drawn = torch.empty(size, dtype=torch.float64).exponential_(generator=generator)
    weights = (drawn / drawn.sum()).float()
    code = weights.to(values) @ values[slots.to(values.device)]
    return BankSample(f"{kind}_{number:02d}", kind, tuple(slots.tolist()), tuple(weights.tolist()), code)
