"""Lambertian shading of compact lists of pixels (Sec. 3.1, "Appearance")."""

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn import functional as F

from fauna.types import Light

_GRAZING = 0.1
"""Cosine between view and smooth normal below which the flat normal takes over."""


def shade(
    albedo: Float[Tensor, "pixel 3"],
    normal: Float[Tensor, "pixel 3"],
    flat: Float[Tensor, "pixel 3"],
    view: Float[Tensor, "pixel 3"],
    light: Light,
    row: Int[Tensor, " pixel"],
) -> Float[Tensor, "pixel 3"]:
    """``albedo * (ambient + diffuse * max(0, direction . n))``, not clamped.

    Args:
        albedo: in [0, 1].
        normal: interpolated vertex normals, camera frame, any positive length.
        flat: face normals, camera frame, any positive length.
        view: from the surface to the camera, camera frame, any positive length.
        light: of each row.
        row: of each pixel.
    """
    facing = shading_normal(normal, flat, view)
    direction = light.direction.index_select(0, row)
    cosine = (direction * facing).sum(-1).clamp_min(0.0)
    intensity = light.ambient.index_select(0, row) + light.diffuse.index_select(0, row) * cosine
    return albedo * intensity[:, None]


def shading_normal(
    normal: Float[Tensor, "pixel 3"], flat: Float[Tensor, "pixel 3"], view: Float[Tensor, "pixel 3"]
) -> Float[Tensor, "pixel 3"]:
    """Unit normals of a two-sided surface: turned to the viewer, and flat where the smooth one looks away."""
    normal, flat, view = F.normalize(normal, dim=-1), F.normalize(flat, dim=-1), F.normalize(view, dim=-1)
    away = (flat * view).sum(-1, keepdim=True) < 0
    normal, flat = torch.where(away, -normal, normal), torch.where(away, -flat, flat)
    smoothness = ((view * normal).sum(-1, keepdim=True) / _GRAZING).clamp(0.0, 1.0)
    return F.normalize(torch.lerp(flat, normal, smoothness), dim=-1)
