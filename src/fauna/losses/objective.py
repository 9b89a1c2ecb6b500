"""The training objective: which terms there are, and how rows and weights combine into one number (Sec. 3.2)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fauna.losses.hypothesis import Weighting, hypothesis_loss, row_weights
from fauna.losses.reconstruction import (
    eroded_intersection,
    feature_loss,
    image_loss,
    mask_loss,
    mask_miss_loss,
    mask_spill_loss,
    upsample,
    values_at,
)
from fauna.losses.regularizers import articulation_loss, deformation_loss, side_view_loss
from fauna.stages import Stage
from fauna.types import Batch, Reconstruction
from fauna.viewpoint.selection import mixed_probabilities

IMAGE_TERMS = ("mask", "mask_spill", "mask_miss", "image", "feature")
"""Terms with one value per rendered row; only these enter the hypothesis target."""

TERMS = (*IMAGE_TERMS, "hypothesis", "side_view", "eikonal", "articulation", "deformation", "adversarial")
"""Every term of the generator's loss, by the name used in weights, logs and tables."""


@dataclass(frozen=True)
class Losses:
    """Loss terms of one micro-batch.

    Attributes:
        total: weighted sum, differentiable.
        terms: unweighted value of every active term.
        measured: (row,) hypothesis target of each row.
        weights: (row,) weight of each row in the batch mean.
    """

    total: Float[Tensor, ""]
    terms: Mapping[str, Float[Tensor, ""]]
    measured: Float[Tensor, " row"]
    weights: Float[Tensor, " row"]


@dataclass(frozen=True)
class Objective:
    """Weighted sum of all terms that need no further network.

    Attributes:
        weighting: of rows in the batch mean: ``uniform`` (paper), ``probability`` (published code) or ``softmin``.
        articulation_norm: ``vector`` (paper) or ``component`` (published code).
        softmin_temperature: of the softmin over hypotheses, relative to their mean loss; ``null`` = the stage's.
    """

    weighting: Weighting
    articulation_norm: Literal["vector", "component"]
    softmin_temperature: float | None

    def __call__(
        self,
        batch: Batch,
        targets: Float[Tensor, "batch chan grid_height grid_width"],
        out: Reconstruction,
        stage: Stage,
        extra: Mapping[str, Float[Tensor, ""]],
    ) -> Losses:
        """Combine the terms; ``extra`` holds scalars computed elsewhere (``eikonal``, ``adversarial``)."""
        rows = image_terms(batch, targets, out, stage)
        measured = sum(
            (stage.target_weights.get(name, 0.0) * value.detach() for name, value in rows.items()),
            start=torch.zeros_like(out.renders.silhouette[:, 0, 0]),
        )
        hypotheses, chosen = out.hypotheses, (out.selection.photo, out.selection.hypothesis)
        probabilities = mixed_probabilities(hypotheses, stage.uniform_mix).detach()
        weights = row_weights(
            self.weighting,
            probability=probabilities[chosen],
            relative=probabilities[chosen] / probabilities.amax(dim=1)[out.selection.photo],
            measured=measured,
            num_hypotheses=hypotheses.predicted_losses.shape[1],
            temperature=self.softmin_temperature or stage.temperature,
            all_rendered=measured.shape[0] > batch.images.shape[0],
        )
        terms = {name: (value * weights).mean() for name, value in rows.items()}
        terms["hypothesis"] = hypothesis_loss(hypotheses.predicted_losses[chosen], measured)
        if stage.weight("side_view"):
            terms["side_view"] = (side_view_loss(out.hypotheses.rotations[chosen]) * weights).mean()
        if out.pose is not None and stage.weight("articulation"):
            terms["articulation"] = articulation_loss(out.pose.angles, self.articulation_norm)
        if out.instance.offsets is not None and stage.weight("deformation"):
            terms["deformation"] = deformation_loss(out.instance.offsets)
        terms.update(extra)
        weighted = (stage.weight(name) * value for name, value in terms.items() if stage.weight(name))
        total = sum(weighted, start=measured.new_zeros(()))
        return Losses(total, terms, measured, weights)


def compared_pixels(
    batch: Batch, photo: Int[Tensor, " row"], silhouette: Float[Tensor, "row height width"]
) -> Bool[Tensor, "row height width"]:
    """Pixels whose colour and features are compared with the photo's; all others need no shading in training."""
    return eroded_intersection(silhouette, batch.masks[photo], batch.valid[photo])


def image_terms(
    batch: Batch,
    targets: Float[Tensor, "batch chan grid_height grid_width"],
    out: Reconstruction,
    stage: Stage,
) -> dict[str, Float[Tensor, " row"]]:
    """Per-row image terms; a term whose weight and target weight are both zero is not computed."""
    photo, renders = out.selection.photo, out.renders
    mask, valid = batch.masks[photo], batch.valid[photo]
    wanted = {name for name in IMAGE_TERMS if stage.weight(name) or stage.target_weights.get(name, 0.0)}
    terms = {}
    if "mask" in wanted:
        terms["mask"] = mask_loss(renders.silhouette, mask, valid)
    if "mask_spill" in wanted:
        terms["mask_spill"] = mask_spill_loss(renders.silhouette, batch.distance_outside[photo])
    if "mask_miss" in wanted:
        terms["mask_miss"] = mask_miss_loss(renders.silhouette, batch.distance_inside[photo])
    if wanted & {"image", "feature"}:
        listed = renders.shading
        region = compared_pixels(batch, photo, renders.silhouette)
        weight = region.reshape(-1)[listed.pixels] / listed.share
        where = (weight, listed.row, len(photo), mask.shape[-2] * mask.shape[-1])
        of_pixel = photo[listed.row]
        if "image" in wanted:
            terms["image"] = image_loss(listed.rgb, values_at(batch.images, of_pixel, listed.pixels), *where)
        if "feature" in wanted:
            height, width = mask.shape[-2:]
            target = values_at(upsample(targets, height, width), of_pixel, listed.pixels)
            terms["feature"] = feature_loss(listed.features, target, *where)
    return terms
