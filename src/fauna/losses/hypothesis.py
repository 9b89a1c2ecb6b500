"""Losses that concern the viewpoint hypotheses (supplement, "Viewpoint Learning Details")."""

from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

Weighting = Literal["uniform", "probability", "softmin"]


def hypothesis_loss(predicted: Float[Tensor, " row"], measured: Float[Tensor, " row"]) -> Float[Tensor, ""]:
    """Mean of (sigma_k - detach(L_rec,k))^2 over the rendered rows."""
    return (predicted - measured.detach()).square().mean()


@torch.no_grad()
def row_weights(
    weighting: Weighting,
    *,
    probability: Float[Tensor, " row"],
    relative: Float[Tensor, " row"],
    measured: Float[Tensor, " row"],
    num_hypotheses: int,
    temperature: float,
    all_rendered: bool,
) -> Float[Tensor, " row"]:
    """Weight of each rendered row in the batch mean; the mean weight is 1 at uniform probabilities.

    One sampled row per photo: ``probability`` gives hyp * p_k (published code), ``uniform`` 1 (paper), ``softmin``
    ``relative``: p_k over the largest p of the photo, so that a viewpoint drawn for exploration trains its score, but
    shape and pose only as far as it is believed.
    All rows rendered: the weights of a photo are a softmin of its measured losses, relative to their mean,
    scaled so that they sum to the number of hypotheses (``uniform``: plain mean over the hypotheses).
    """
    if weighting == "uniform":
        return torch.ones_like(measured)
    if not all_rendered:
        return probability * num_hypotheses if weighting == "probability" else relative
    losses = measured.reshape(-1, num_hypotheses)  # (batch, hyp), photo-major
    relative = losses / losses.mean(dim=1, keepdim=True).clamp_min(1e-12)
    weights = torch.softmax(-relative / temperature, dim=1) * num_hypotheses
    return weights.reshape(-1)
