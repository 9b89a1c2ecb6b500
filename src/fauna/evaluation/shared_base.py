"""One base mesh per species: every photograph is reconstructed anew with the mean shape code of its species.

All meshes of a species then have the same triangles, and a vertex index names the same place on each: the second way, beside
bone-local coordinates, of saying which points correspond (setting ``shared_base``).
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fauna.bank.base import Bank
from fauna.data.photos import Photo
from fauna.evaluation.baselines.base import Bench, Reconstruct
from fauna.evaluation.predict import predict
from fauna.evaluation.prediction import Prediction
from fauna.model import FaunaModel
from fauna.types import BankReadout


class OneCode(Bank):
    """Answers every query with the same code.

    Args:
        code: the answer.
    """

    def __init__(self, *, code: Float[Tensor, " value_chan"]) -> None:
        super().__init__()
        self.value_dim = len(code)
        self.register_buffer("code", code)

    def forward(self, query: Float[Tensor, "batch global_chan"], category: int | None) -> BankReadout:
        """The code, repeated over the batch."""
        return BankReadout(self.get_buffer("code").expand(query.shape[0], -1))


def shared_base(bench: Bench) -> Reconstruct:
    """A function that reconstructs a photograph with its species' base mesh; all else is predicted from the photograph."""
    codes = mean_codes(bench)

    def reconstruct(photo: Photo) -> Prediction:
        batch = bench.data.single(photo).to(bench.model.device)
        code = torch.from_numpy(codes[photo.category]).to(bench.model.device)
        with answering(bench.model, code):
            return predict(bench.model, batch, category=photo.category, size=bench.size)[0]

    return reconstruct


def mean_codes(bench: Bench) -> Mapping[str, Float[np.ndarray, " value_chan"]]:
    """Mean of the codes that the bank gave to the photographs of each species."""
    codes: dict[str, list[np.ndarray]] = {}
    for name, code in bench.codes.items():
        codes.setdefault(bench.samples[name].category, []).append(code)
    return {species: np.stack(of_species).mean(axis=0) for species, of_species in codes.items()}


@contextmanager
def answering(model: FaunaModel, code: Float[Tensor, " value_chan"]) -> Iterator[None]:
    """The model with a bank that has one answer; its own bank is put back at the end."""
    own = model.bank
    model.bank = OneCode(code=code)
    try:
        yield
    finally:
        model.bank = own
