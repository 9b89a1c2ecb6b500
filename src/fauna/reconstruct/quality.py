"""How far a reconstruction can be trusted, from what is known without truth."""

import math
from dataclasses import dataclass

import torch
from torch.nn import functional as F

from fauna.model import FaunaModel
from fauna.reconstruct.settings import QualitySettings
from fauna.reconstruct.status import Status
from fauna.types import Batch, Reconstruction


@dataclass(frozen=True)
class Measures:
    """What confidence is made of.

    Attributes:
        iou: of mask and rendered silhouette, in [0, 1].
        ambiguity: entropy of the viewpoint hypotheses relative to that of equal ones, in [0, 1].
        similarity: largest cosine of the photograph's feature and the bank's keys; ``None`` for banks without keys.
        strangeness: root mean square of the photograph's global feature, in deviations of the training photographs' features
            from their mean: about 1 for photographs like those.
    """

    iou: float
    ambiguity: float
    similarity: float | None
    strangeness: float


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
    features = model.encode(batch)
    keys = getattr(model.bank, "keys", None)
    similarity = None
    if isinstance(keys, torch.Tensor):
        query = model.feature_space.normalize(features).global_[:1]
        similarity = float(F.cosine_similarity(query, keys, dim=-1).max())
    space = model.feature_space
    deviations = (features.global_[0] - space.global_mean) / space.global_std.clamp_min(1e-6)
    return Measures(float(overlap), float(entropy), similarity, float(deviations.square().mean().sqrt()))


def confidence(measures: Measures, settings: QualitySettings) -> float:
    """Probability, by a logistic model, that there is a four-legged animal in the mask; in [0, 1].

    It rises with the overlap of the outlines and falls with the strangeness of the picture, and was calibrated for the weights before the present ones,
    under equally many animals and other things (``docs/reconstruct.md`` says on what, and how often it errs). It says nothing
    about parts that the photograph does not show.
    """
    score = settings.bias + settings.iou * measures.iou - settings.strangeness * measures.strangeness
    return 1.0 / (1.0 + math.exp(-max(min(score, 50.0), -50.0)))


def judge(measures: Measures, settings: QualitySettings) -> tuple[Status, str]:
    """``ok`` or ``not_a_quadruped``, and why."""
    sure = confidence(measures, settings)
    if sure >= settings.quadruped:
        return "ok", ""
    return "not_a_quadruped", (
        f"expected a four-legged animal, got something that hardly looks like one (confidence {sure:.2f}, outline IoU "
        f"{measures.iou:.2f}, strangeness {measures.strangeness:.1f}); look at preview.png, or give a better mask"
    )
