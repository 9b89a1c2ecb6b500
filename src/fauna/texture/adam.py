"""Adam (Kingma and Ba, 2015, algorithm 1) as ``torch.optim.Adam`` computes it.

The constructor of every ``torch.optim`` optimiser imports torch's compiler, a quarter of the time of a cold command.
"""

from collections.abc import Iterable

import torch
from torch import Tensor

BETAS, EPSILON = (0.9, 0.999), 1e-8
"""Of the paper and of ``torch.optim.Adam``."""


class Adam:
    """Changes parameters along their gradients.

    Args:
        parameters: leaves that ask for gradients.
    """

    def __init__(self, parameters: Iterable[Tensor]) -> None:
        self.parameters = tuple(parameters)
        self.means = [torch.zeros_like(each) for each in self.parameters]
        self.squares = [torch.zeros_like(each) for each in self.parameters]
        self.steps = 0

    def zero_grad(self) -> None:
        """Forget the gradients."""
        for each in self.parameters:
            each.grad = None

    @torch.no_grad()
    def step(self, lr: float) -> None:
        """One step; parameters without a gradient stay.

        Args:
            lr: learning rate.
        """
        self.steps += 1
        first, second = (1.0 - beta**self.steps for beta in BETAS)
        for value, mean, square in zip(self.parameters, self.means, self.squares, strict=True):
            if value.grad is not None:
                mean.lerp_(value.grad, 1.0 - BETAS[0])
                square.mul_(BETAS[1]).addcmul_(value.grad, value.grad, value=1.0 - BETAS[1])
                value.addcdiv_(mean, (square.sqrt() / second**0.5).add_(EPSILON), value=-lr / first)
