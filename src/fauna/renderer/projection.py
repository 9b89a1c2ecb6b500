"""From clip positions to pixel units."""

import torch
from jaxtyping import Float
from torch import Tensor

SNAP = 65536.0
MIN_W = 1e-6


def to_pixels(
    clip_verts: Float[Tensor, "*batch 4"], height: int, width: int
) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
    """Screen x and y in pixels, float64; the centre of pixel (row i, column j) is at x = j, y = i. Differentiable."""
    clip = clip_verts.double()
    w = clip[..., 3]
    return (clip[..., 0] / w + 1) * (0.5 * width) - 0.5, (clip[..., 1] / w + 1) * (0.5 * height) - 0.5


@torch.no_grad()
def to_screen(
    clip_verts: Float[Tensor, "row vert 4"], height: int, width: int, snap: bool
) -> Float[Tensor, "row vert 3"]:
    """Screen x, y (pixels) and NDC depth, float64, without gradient; NaN where w <= 0 or anything is not finite.

    Args:
        clip_verts: homogeneous positions.
        height: of the image, pixels.
        width: of the image, pixels.
        snap: round x and y to 1/65536 px. Products of snapped coordinates are exact in float64 (images up to about
            1000 px), so two triangles agree bit by bit about the pixel centres on their common edge: no gaps.
    """
    x, y = to_pixels(clip_verts, height, width)
    w = clip_verts[..., 3].double()
    z = clip_verts[..., 2].double() / w
    valid = (w > MIN_W) & w.isfinite() & x.isfinite() & y.isfinite() & z.isfinite()
    screen = torch.stack((x, y, z), dim=-1)
    if snap:
        screen[..., :2] = (screen[..., :2] * SNAP).round() / SNAP
    return screen.masked_fill(~valid[..., None], torch.nan)
