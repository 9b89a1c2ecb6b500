"""Blending across silhouettes, for whole coverages and for lists of pixels. The rule is in ``fauna.renderer.edges``."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor


@dataclass(frozen=True)
class Contour:
    """What neighbouring pixels take of each other: two transfers per crossing, the inner pixel's and the outer's.

    Attributes:
        target: flat index into (row, height, width) of the pixel that takes on colour.
        source: of the neighbour it takes it from.
        share: how much of it, in [0, 1]; differentiable to the geometry.
    """

    target: Int[Tensor, " transfer"]
    source: Int[Tensor, " transfer"]
    share: Float[Tensor, " transfer"]


def blend_coverage(covered: Bool[Tensor, "row height width"], contour: Contour) -> Float[Tensor, "row height width"]:
    """Antialiased coverage in [0, 1], in the precision of the contour's shares."""
    hard = covered.reshape(-1).to(contour.share)
    change = contour.share * (hard[contour.source] - hard[contour.target])
    return hard.index_add(0, contour.target, change).clamp(0.0, 1.0).reshape(covered.shape)


def blend_at(
    values: Float[Tensor, "pixel chan"], pixels: Int[Tensor, " pixel"], contour: Contour, count: int
) -> Float[Tensor, "pixel chan"]:
    """Blend values known at some pixels; a pixel that is not listed counts as zero.

    Args:
        values: per listed pixel.
        pixels: flat indices into (row, height, width), each at most once.
        contour: of the same images.
        count: row * height * width.
    """
    place = torch.full((count,), -1, device=pixels.device).index_copy(
        0, pixels, torch.arange(len(pixels), device=pixels.device)
    )
    target, source = place[contour.target], place[contour.source]
    known = (target >= 0).nonzero()[:, 0]
    target, source = target[known], source[known]
    here, there = values.index_select(0, target), values.index_select(0, source.clamp(min=0))
    difference = there * (source >= 0)[:, None] - here
    return values.index_add(0, target, contour.share[known].to(values.dtype)[:, None] * difference)
