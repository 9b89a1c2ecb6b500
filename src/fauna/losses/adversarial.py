"""Losses of the mask discriminator (Eq. 6 of the paper in its non-saturating form, gradient penalty as in GIRAFFE)."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

Logits = Float[Tensor, "batch *one"]


def adversarial_loss(fake_logits: Logits) -> Float[Tensor, ""]:
    """Generator: -log sigmoid(D(fake)), mean over the batch."""
    return F.softplus(-fake_logits).mean()


def discriminator_loss(real_logits: Logits, fake_logits: Logits) -> Float[Tensor, ""]:
    """Discriminator: half the sum of both binary cross entropies (0.693 when D is undecided)."""
    return 0.5 * (F.softplus(-real_logits).mean() + F.softplus(fake_logits).mean())


def gradient_penalty(real_logits: Logits, *inputs: Tensor) -> Float[Tensor, ""]:
    """R1: mean over the batch of the squared gradient norm of D at the real samples, over all given inputs."""
    grads = torch.autograd.grad(real_logits.sum(), inputs, create_graph=True)
    return sum((grad.square().flatten(1).sum(dim=1) for grad in grads), start=torch.zeros(())).mean()
