"""The interface of all banks: what turns a photo's global descriptor into a shape code."""

from abc import ABC, abstractmethod

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fauna.types import BankReadout


class Bank(nn.Module, ABC):
    """Maps image descriptors to shape codes.

    Attributes:
        value_dim: width of the shape code.
    """

    value_dim: int

    @abstractmethod
    def forward(self, query: Float[Tensor, "batch global_chan"], category: int | None) -> BankReadout:
        """Answer a query.

        Args:
            query: one descriptor per photo.
            category: index of the batch's species, ``None`` where unknown. Only ``CategoryBank`` reads it.
        """


@torch.no_grad()
def slot_entropy(readout: BankReadout) -> Float[Tensor, " batch"]:
    """Entropy of the absolute slot weights in nats, from 0 (one slot) to log(K); zeros for banks without slots."""
    if readout.weights is None:
        return torch.zeros_like(readout.embedding[:, 0])
    return torch.special.entr(readout.weights.abs()).sum(dim=-1)
