"""Ablation: one learned code per species label (Sec. 4.4, "category-conditioned")."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fauna.bank.base import Bank
from fauna.errors import FaunaError
from fauna.types import BankReadout


class CategoryBank(Bank):
    """A table of codes, indexed by the species of the batch, which must be known also at test time.

    Args:
        num_categories: number of species of the training set.
        value_dim: width of the code.
        init: codes start uniform in [-init, init].

    Raises:
        FaunaError: when ``num_categories`` is below 1.
    """

    def __init__(self, *, num_categories: int, value_dim: int, init: float) -> None:
        super().__init__()
        if num_categories < 1:
            raise FaunaError(f"bank.num_categories must be >= 1, got {num_categories}; give the number of species")
        self.value_dim = value_dim
        self.values = nn.Parameter(torch.empty(num_categories, value_dim).uniform_(-init, init))

    def forward(self, query: Float[Tensor, "batch global_chan"], category: int | None) -> BankReadout:
        """The code of the species, repeated over the batch; the query's content is ignored.

        Raises:
            FaunaError: when the species is unknown or was not trained.
        """
        known = self.values.shape[0]
        if category is None or not 0 <= category < known:
            raise FaunaError(
                f"bank=category needs a category index in 0..{known - 1}, got {category}; "
                "label the photo with a trained species or use bank=semantic"
            )
        return BankReadout(self.values[category].expand(query.shape[0], -1))
