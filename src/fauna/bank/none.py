"""Ablation: no bank (Sec. 4.4)."""

from jaxtyping import Float
from torch import Tensor

from fauna.bank.base import Bank
from fauna.types import BankReadout


class NoBank(Bank):
    """Conditions the base shape on the image descriptor itself; has no parameters.

    Args:
        query_dim: width of the descriptor and so of the code.
    """

    def __init__(self, *, query_dim: int) -> None:
        super().__init__()
        self.value_dim = query_dim

    def forward(self, query: Float[Tensor, "batch global_chan"], category: int | None) -> BankReadout:
        """The query, unchanged."""
        return BankReadout(query)
