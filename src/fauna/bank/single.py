"""Baseline: one learned code for everything, i.e. one base shape for all species."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fauna.bank.base import Bank
from fauna.types import BankReadout


class SingleBank(Bank):
    """A single learned code (supplement, "MagicPony on All Categories").

    Args:
        value_dim: width of the code.
        init: the code starts uniform in [-init, init].
    """

    def __init__(self, *, value_dim: int, init: float) -> None:
        super().__init__()
        self.value_dim = value_dim
        self.value = nn.Parameter(torch.empty(value_dim).uniform_(-init, init))

    def forward(self, query: Float[Tensor, "batch global_chan"], category: int | None) -> BankReadout:
        """The code, repeated over the batch; query and category are ignored."""
        return BankReadout(self.value.expand(query.shape[0], -1))
