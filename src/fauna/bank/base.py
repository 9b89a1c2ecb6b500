"""The interface of all banks: what turns a photo's global descriptor into a shape code."""

from abc import ABC, abstractmethod
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fauna.types import BankReadout

BatchCode = Literal["mean", "one"]


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


def shape_code(
    readout: BankReadout, batch_code: BatchCode, generator: torch.Generator | None
) -> Float[Tensor, " value_chan"]:
    """The shape code that all photos of a batch share, which show one species.

    Args:
        readout: of each photo.
        batch_code: ``mean`` over the photos (Sec. 3.1), or that of ``one`` of them.
        generator: draws the one; without it, as at test time, the code is the mean.
    """
    codes = readout.embedding
    if batch_code == "mean" or generator is None:
        return codes.mean(dim=0)
    return codes[int(torch.randint(codes.shape[0], (), generator=generator))]
