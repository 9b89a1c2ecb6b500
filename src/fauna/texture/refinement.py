"""Bone angles and camera of photographs fitted to their masks, the shape left as predicted."""

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from fauna.errors import FaunaError
from fauna.losses.reconstruction import mask_loss, mask_miss_loss, mask_spill_loss
from fauna.metrics.iou import silhouette_iou
from fauna.model import FaunaModel
from fauna.renderer.deferred import render, render_silhouette
from fauna.texture.adam import Adam
from fauna.texture.fitting import FreePose
from fauna.texture.visible import texture_embedding
from fauna.types import Batch, Reconstruction


@dataclass(frozen=True)
class RefineOptions:
    """How a pose is fitted: weights of per-image means, as in training, and the optimiser.

    Attributes:
        mask: squared difference of silhouette and mask.
        spill: silhouette outside the mask by its distance to it.
        miss: mask without silhouette by its depth inside.
        keep: mean squared change of the angles, rad^2: bones the outline says nothing about stay.
        lr: of Adam at the start; falls to 0 along a cosine. Angles in units of their limits, else radians and world units.
    """

    mask: float = 10.0
    spill: float = 100.0
    miss: float = 100.0
    keep: float = 1.0
    lr: float = 0.03


@dataclass(frozen=True)
class Refined:
    """A reconstruction that has seen the mask it is compared with: not a feed-forward result.

    Attributes:
        out: with fitted pose and camera, rendered anew.
        steps: of the optimiser.
        iou_before: of silhouette and mask as predicted, per photograph.
        iou_after: as fitted; the fit never raises the loss, the IoU it may lower a little.
    """

    out: Reconstruction
    steps: int
    iou_before: tuple[float, ...]
    iou_after: tuple[float, ...]


DEFAULTS = RefineOptions()


def refine(
    model: FaunaModel, batch: Batch, out: Reconstruction, *, steps: int, options: RefineOptions = DEFAULTS
) -> Refined:
    """Fit bone angles, within the limits of the model, and the camera to the masks.

    Args:
        model: in evaluation mode; not changed.
        batch: the photographs of ``out``.
        out: one row for each photograph.
        steps: of Adam; the best of all steps is kept for each photograph.
        options: of the fit.

    Raises:
        FaunaError: for a negative number of steps, or a reconstruction with several rows for a photograph.
    """
    if steps < 0:
        raise FaunaError(f"refine: expected a number of steps >= 0, got {steps}; 80 do for most photographs")
    rows, photos = len(out.selection.photo), len(batch.names)
    if rows != photos:
        raise FaunaError(f"refine: expected one row for each of {photos} photos, got {rows}; reconstruct without draws")
    pose = FreePose(model=model, start=out, free="both")
    best = _fit(model, batch, pose, steps, options)
    fitted = _rendered(model, pose.result(best), (batch.masks.shape[-2], batch.masks.shape[-1]))
    before, after = (tuple(silhouette_iou(each.renders.silhouette, batch.masks).tolist()) for each in (out, fitted))
    return Refined(fitted, steps, before, after)


@torch.enable_grad()
def _fit(model: FaunaModel, batch: Batch, pose: FreePose, steps: int, options: RefineOptions) -> dict[str, Tensor]:
    """The parameters with the lowest loss, each row on its own."""
    parameters, size = pose.parameters, (batch.masks.shape[-2], batch.masks.shape[-1])
    optimizer = Adam(parameters.values())
    best = {name: value.detach().clone() for name, value in parameters.items()}
    lowest = batch.masks.new_full((len(batch.masks),), torch.inf)
    for step in range(steps + 1):
        posed, camera, angles = pose.at(parameters)
        silhouette = render_silhouette(model.renderer, posed, camera, size, topology=pose.start.base.topology)
        losses = _losses(batch, silhouette, options)
        if angles is not None and pose.start.pose is not None:
            losses = losses + options.keep * (angles.angles - pose.start.pose.angles).square().mean(dim=(1, 2))
        better = losses.detach() < lowest
        lowest = torch.where(better, losses.detach(), lowest)
        for name, value in parameters.items():
            best[name][better] = value.detach()[better]
        if step < steps:
            optimizer.zero_grad()
            losses.sum().backward()
            optimizer.step(options.lr * 0.5 * (1.0 + math.cos(math.pi * step / steps)))
    return best


def _losses(
    batch: Batch, silhouette: Float[Tensor, "row height width"], options: RefineOptions
) -> Float[Tensor, " row"]:
    return (
        options.mask * mask_loss(silhouette, batch.masks, batch.valid)
        + options.spill * mask_spill_loss(silhouette * batch.valid, batch.distance_outside)
        + options.miss * mask_miss_loss(silhouette, batch.distance_inside)
    )


@torch.no_grad()
def _rendered(model: FaunaModel, out: Reconstruction, size: tuple[int, int]) -> Reconstruction:
    renders = render(
        model.renderer,
        out.posed,
        out.base.topology,
        out.camera,
        size,
        appearance=model.appearance,
        texture=texture_embedding(out),
        code=out.code,
        light=out.light,
        feature_lookup=model.feature_lookup,
        wanted=None,
        share=1.0,
        generator=None,
    )
    return replace(out, renders=renders)
