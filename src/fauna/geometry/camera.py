"""Pinhole cameras as pure functions. Frames: ``docs/conventions.md``, section "Frames"."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from fauna.geometry.constants import constant
from fauna.types import Camera

NEAR = 0.1
"""Distance of the near plane, world units."""
FAR = 1000.0
"""Distance of the far plane, world units."""


def clip_from_camera(fov_deg: float, near: float, far: float) -> Float[Tensor, "4 4"]:
    """Projection of a square image; flips y, so that NDC is x right, y DOWN.

    Args:
        fov_deg: full angle of view, the same horizontally and vertically, degrees.
        near: distance of the near plane, world units.
        far: distance of the far plane, world units.
    """
    return torch.tensor(_projection(fov_deg, near, far))


def _projection(fov_deg: float, near: float, far: float) -> tuple[tuple[float, ...], ...]:
    focal = 1.0 / math.tan(math.radians(fov_deg) / 2)
    depth, offset = -(far + near) / (far - near), -2 * far * near / (far - near)
    return ((focal, 0.0, 0.0, 0.0), (0.0, -focal, 0.0, 0.0), (0.0, 0.0, depth, offset), (0.0, 0.0, -1.0, 0.0))


def make_camera(
    rotation: Float[Tensor, "row 3 3"], translation: Float[Tensor, "row 3"], *, fov_deg: float, distance: float
) -> Camera:
    """Cameras ``camera_from_world = [rotation | translation + (0, 0, -distance)]``.

    Args:
        rotation: camera_from_world rotations.
        translation: offset of the object from its nominal place in front of the camera, world units.
        fov_deg: angle of view, degrees.
        distance: nominal distance of the object, world units.
    """
    place = translation - constant((0.0, 0.0, distance), translation)
    upper = torch.cat((rotation, place[..., None]), dim=-1)  # (row, 3, 4)
    bottom = constant((0.0, 0.0, 0.0, 1.0), upper).expand(*upper.shape[:-2], 1, 4)
    camera_from_world = torch.cat((upper, bottom), dim=-2)
    return Camera(camera_from_world, constant(_projection(fov_deg, NEAR, FAR), upper) @ camera_from_world)


def to_clip(
    verts: Float[Tensor, "#row vert 3"], clip_from_world: Float[Tensor, "#row 4 4"]
) -> Float[Tensor, "rows vert 4"]:
    """Homogeneous clip coordinates; a leading axis of 1 is shared by all rows."""
    return transform_points(verts, clip_from_world)


def transform_points(
    points: Float[Tensor, "#row point 3"], matrix: Float[Tensor, "#row out 4"]
) -> Float[Tensor, "rows point out"]:
    """Apply affine (3 x 4) or projective (4 x 4) matrices; a leading axis of 1 is shared by all rows."""
    return points @ matrix[:, :, :3].transpose(1, 2) + matrix[:, None, :, 3]


def project(points: Float[Tensor, "#row point 3"], camera: Camera) -> Float[Tensor, "rows point 2"]:
    """NDC of world points: x right, y down, the image is [-1, 1]^2.

    Points nearer than the near plane, also behind the camera, are divided by the near distance and so stay finite.
    """
    clip = to_clip(points, camera.clip_from_world)
    return clip[..., :2] / clip[..., 3:].clamp_min(NEAR)
