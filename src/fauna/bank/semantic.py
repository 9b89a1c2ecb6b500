"""The Semantic Bank of Skinned Models (Sec. 3.1, Eq. 1, with the top-k of the supplement, "Network Architectures")."""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional as F

from fauna.bank.base import Bank
from fauna.errors import FaunaError
from fauna.types import BankReadout


class SemanticBank(Bank):
    """Slots of learned keys and values; the code is a sparse, signed mixture of the values.

    The ``min(top_k, num_slots)`` slots most similar to the query get weights ``cos_k / sum |cos|``, so a negative
    similarity keeps its sign, and the code is the weighted sum of their values. (The paper divides by ``sum cos``,
    which is the same while no chosen similarity is negative and can vanish otherwise.)

    Args:
        num_slots: K, number of slots.
        top_k: number of slots that contribute to a code.
        value_dim: width of the code.
        query_dim: width of queries and keys.
        key_init: keys start uniform in [-key_init, key_init].
        value_init: values start uniform in [-value_init, value_init].
        num_value_prototypes: number of different initial values, repeated over the slots in turn; ``None`` draws every
            slot's own.

    Raises:
        FaunaError: when a count is below 1.
    """

    def __init__(
        self,
        *,
        num_slots: int,
        top_k: int,
        value_dim: int,
        query_dim: int,
        key_init: float,
        value_init: float,
        num_value_prototypes: int | None,
    ) -> None:
        super().__init__()
        prototypes = num_slots if num_value_prototypes is None else num_value_prototypes
        _require_positive(num_slots=num_slots, top_k=top_k, num_value_prototypes=prototypes)
        self.value_dim = value_dim
        self.top_k = min(top_k, num_slots)
        self.keys = nn.Parameter(torch.empty(num_slots, query_dim).uniform_(-key_init, key_init))
        values = torch.empty(prototypes, value_dim).uniform_(-value_init, value_init)
        self.values = nn.Parameter(values[torch.arange(num_slots) % prototypes])

    def forward(self, query: Float[Tensor, "batch global_chan"], category: int | None) -> BankReadout:
        """Mix the values of the most similar slots; ``category`` is ignored.

        All slots are only compared; what is differentiated are the chosen ones, so that nothing of the size of the
        bank is kept for the backward pass.
        """
        query = F.normalize(query, dim=-1)
        slots = self._most_similar(query)
        keys = F.normalize(F.embedding(slots, self.keys), dim=-1)  # (batch, top_k, query_dim)
        weights = F.normalize((keys @ query[..., None])[..., 0], p=1.0, dim=-1)
        return BankReadout((weights[:, None] @ F.embedding(slots, self.values))[:, 0], weights, slots)

    @torch.no_grad()
    def _most_similar(self, query: Float[Tensor, "batch query_dim"]) -> Int[Tensor, "batch top_k"]:
        """Slots of the largest cosines, in descending order."""
        length = torch.linalg.vector_norm(self.keys, dim=-1).clamp_min(1e-12)
        return ((query @ self.keys.T) / length).topk(self.top_k, dim=-1).indices


def _require_positive(**counts: int) -> None:
    for name, count in counts.items():
        if count < 1:
            raise FaunaError(f"bank.{name} must be >= 1, got {count}; the paper uses 60 slots and the 10 most similar")
