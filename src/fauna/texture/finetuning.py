"""Test-time fitting of the texture network to one photograph (Sec. 4.2 of the paper, "fine-tune (only) the texture network")."""

from copy import deepcopy

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fauna.errors import FaunaError
from fauna.losses.reconstruction import eroded_intersection, values_at
from fauna.model import FaunaModel
from fauna.texture.adam import Adam
from fauna.texture.visible import see, texture_embedding
from fauna.types import Batch, Reconstruction

ITERATIONS = 50
"""Of the paper."""
LEARNING_RATE = 1e-3
"""Of Adam; that of the published code, the paper names none."""


@torch.enable_grad()
def finetune(
    model: FaunaModel, batch: Batch, out: Reconstruction, *, iterations: int = ITERATIONS, lr: float = LEARNING_RATE
) -> FaunaModel:
    """A copy of the model whose albedo network is fitted to the photograph.

    Mean absolute colour difference over the pixels where mask and silhouette agree (eroded by one pixel), Adam, one step per
    iteration. Shape, pose, camera and light stay, so the photograph is rasterised once and only the network runs in the loop.

    Args:
        model: in evaluation mode; not changed.
        batch: the photographs of ``out``; images may be of another resolution than those it was reconstructed from.
        out: reconstruction of the batch by the model; all its rows are fitted together.
        iterations: steps of the optimiser; 0 gives an unchanged copy.
        lr: its learning rate.

    Raises:
        FaunaError: for a negative number of iterations, or when mask and silhouette have no pixel in common.
    """
    if iterations < 0:
        raise FaunaError(f"finetune: expected a number of iterations >= 0, got {iterations}; the paper uses 50")
    fitted = deepcopy(model)
    field = fitted.appearance.albedo_field
    size = (batch.images.shape[-2], batch.images.shape[-1])
    seen = see(model.renderer, out, size)
    inside = compared(batch, out, seen.fragments.covered).reshape(-1)[seen.pixels].nonzero()[:, 0]
    if not len(inside):
        raise FaunaError(
            "finetune: expected silhouette and mask to overlap, got no common pixel; leave the texture alone"
        )
    row, points = seen.row[inside], seen.points[inside]
    intensity = seen.intensity[inside][:, None]
    target = values_at(batch.images, out.selection.photo[row], seen.pixels[inside])
    texture = texture_embedding(out).detach()
    optimizer = Adam(field.parameters())
    for _ in range(iterations):
        loss = (fitted.appearance.albedo(points, texture, row) * intensity - target).abs().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step(lr)
    optimizer.zero_grad()
    return fitted


def compared(
    batch: Batch, out: Reconstruction, covered: Bool[Tensor, "row height width"]
) -> Bool[Tensor, "row height width"]:
    """Pixels whose whole neighbourhood belongs to mask, photograph and silhouette."""
    photo = out.selection.photo
    silhouette: Float[Tensor, "row height width"] = covered.to(batch.masks.dtype)
    return eroded_intersection(silhouette, batch.masks[photo], batch.valid[photo])
