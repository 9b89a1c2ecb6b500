"""How far a reconstruction can be trusted, from what is known without truth."""

import math
from dataclasses import dataclass

import torch
from torch.nn import functional as F

from fauna.model import FaunaModel
from fauna.types import Batch, Reconstruction


@dataclass(frozen=True)
class Measures:
    """What confidence is made of.

    Attributes:
        iou: of mask and rendered silhouette, in [0, 1].
        ambiguity: entropy of the viewpoint hypotheses relative to that of equal ones, in [0, 1].
        similarity: largest cosine of the photograph's feature and the bank's keys; ``None`` for banks without keys.
    """

    iou: float
    ambiguity: float
    similarity: float | None


@torch.no_grad()
def measure(model: FaunaModel, batch: Batch, out: Reconstruction) -> Measures:
    """Measure a reconstruction of one photograph.

    Args:
        model: that made it.
        batch: with features.
        out: of the batch.
    """
    mask, silhouette = batch.masks[0], out.renders.silhouette[0]
    overlap = torch.minimum(mask, silhouette).sum() / torch.maximum(mask, silhouette).sum().clamp_min(1e-6)
    shares = out.hypotheses.probabilities[0].double().clamp_min(1e-12)
    entropy = -(shares * shares.log()).sum() / math.log(max(len(shares), 2))
    keys = getattr(model.bank, "keys", None)
    similarity = None
    if isinstance(keys, torch.Tensor):
        query = model.feature_space.normalize(model.encode(batch)).global_[:1]
        similarity = float(F.cosine_similarity(query, keys, dim=-1).max())
    return Measures(float(overlap), float(entropy), similarity)


def confidence(measures: Measures) -> float:
    """The overlap of outlines."""
    return measures.iou
