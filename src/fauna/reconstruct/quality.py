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
        distinctness: root mean square of the local features within the mask, in deviations of the training photographs'
            local features from their mean: about 1.4 on animals, 1 on ground, sky or grass.
    """

    iou: float
    ambiguity: float
    similarity: float | None
    strangeness: float
    distinctness: float


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
    chances = out.hypotheses.probabilities[0].double().clamp_min(1e-12)
    entropy = -(chances * chances.log()).sum() / math.log(max(len(chances), 2))
    features = model.encode(batch)
    keys = getattr(model.bank, "keys", None)
    similarity = None
    if isinstance(keys, torch.Tensor):
        query = model.feature_space.normalize(features).global_[:1]
        similarity = float(F.cosine_similarity(query, keys, dim=-1).max())
    space = model.feature_space
    deviations = (features.global_[0] - space.global_mean) / space.global_std.clamp_min(1e-6)
    local = (features.tokens[0] - space.token_mean[:, None, None]) / space.token_std[:, None, None].clamp_min(1e-6)
    shares = F.adaptive_avg_pool2d(mask[None], (local.shape[-2], local.shape[-1]))[0]
    distinct = (local.square().mean(dim=0) * shares).sum() / shares.sum().clamp_min(1e-6)
    return Measures(
        iou=float(overlap),
        ambiguity=float(entropy),
        similarity=similarity,
        strangeness=float(deviations.square().mean().sqrt()),
        distinctness=float(distinct.sqrt()),
    )


def confidence(measures: Measures, settings: QualitySettings) -> float:
    """Probability, by a logistic model, that there is a four-legged animal in the mask; in [0, 1].

    It rises with the overlap of the outlines and with what is distinct in the mask, falls with the strangeness of the
    picture, and was calibrated for the weights that the settings name, under equally many animals and other things
    (``docs/reconstruct.md`` says on what, and how often it errs). It says nothing about parts that the photograph does not
    show.
    """
    score = (
        settings.bias
        + settings.iou * measures.iou
        - settings.strangeness * measures.strangeness
        + settings.distinctness * measures.distinctness
    )
    return 1.0 / (1.0 + math.exp(-max(min(score, 50.0), -50.0)))


def judge(measures: Measures, settings: QualitySettings) -> tuple[Status, str]:
    """``ok`` or ``not_a_quadruped``, and why."""
    sure = confidence(measures, settings)
    if sure >= settings.quadruped:
        return "ok", ""
    return "not_a_quadruped", (
        f"expected a four-legged animal, got something that hardly looks like one (confidence {sure:.2f}, outline IoU "
        f"{measures.iou:.2f}, strangeness {measures.strangeness:.1f}, distinctness {measures.distinctness:.1f}); look at "
        "preview.png, or give a better mask"
    )
