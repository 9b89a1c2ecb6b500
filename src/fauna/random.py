"""Random draws that are a pure function of (seed, step, purpose, index).

Nothing in training reads a global random state, so the batch and every draw of step ``s`` can be
reproduced without having run the steps before it.
"""

import hashlib
from dataclasses import dataclass

import torch


def derive_seed(*parts: int | str) -> int:
    """63-bit seed from a tuple of integers and strings, stable across machines and versions.

    >>> derive_seed(0, 1, "jitter") == derive_seed(0, 1, "jitter")
    True
    >>> derive_seed(0, 1, "jitter") == derive_seed(0, 2, "jitter")
    False
    """
    text = "\x1f".join(f"{type(part).__name__}:{part}" for part in parts)
    digest = hashlib.blake2b(text.encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") & (2**63 - 1)


@dataclass(frozen=True)
class Draws:
    """The random draws of one micro-batch of one step.

    Attributes:
        seed: the run's seed.
        step: 0-based training step.
        index: micro-batch within the step (rank times accumulation).
    """

    seed: int
    step: int
    index: int = 0

    def generator(self, purpose: str) -> torch.Generator:
        """A fresh CPU generator for one purpose, e.g. ``"hypothesis"``."""
        generator = torch.Generator(device="cpu")
        generator.manual_seed(derive_seed(self.seed, self.step, purpose, self.index))
        return generator
