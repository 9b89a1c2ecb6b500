"""Rotation matrices. Column vectors, right-handed, radians; frames are defined in ``docs/conventions.md``.

All functions work on any number of leading axes.
"""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from fauna.geometry.constants import constant

_PARALLEL = 1e-6
"""Sine of the angle below which a direction counts as parallel to the vertical."""

_ON_AXES = tuple(float(place in (0, 13, 26)) for place in range(27))
"""What does not depend on the angle in the flattened matrices about x, y and z."""

_COSINES = ((4, 8), (9, 17), (18, 22))
"""Places of the angle's cosine in the three flattened matrices, for each axis."""

_SINES = ((7, 5), (11, 15), (21, 19))
"""Places of its sine and of the negative sine."""

_FROM_TURNS = tuple(
    tuple(float(place in axis) for axis in _COSINES)
    + tuple(float(place == plus) - float(place == minus) for plus, minus in _SINES)
    for place in range(27)
)
"""(27, 6) matrix from three cosines and three sines to the flattened matrices."""


def euler_xyz_to_matrix(angles: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Intrinsic XYZ Euler angles to ``Rx(a0) Ry(a1) Rz(a2)`` (supplement, "Bone Rotation Prediction").

    Args:
        angles: radians.
    """
    turns = torch.cat((angles.cos(), angles.sin()), dim=-1)
    about_axes = F.linear(turns, constant(_FROM_TURNS, angles), constant(_ON_AXES, angles))  # exact: one term is not 0
    about_x, about_y, about_z = about_axes.unflatten(-1, (3, 3, 3)).unbind(-3)
    return about_x @ about_y @ about_z


def rotation_y(angle: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3 3"]:
    """Rotation about the vertical axis; a positive angle (radians) turns +z towards +x."""
    cos, sin, zero, one = angle.cos(), angle.sin(), torch.zeros_like(angle), torch.ones_like(angle)
    return torch.stack((cos, zero, sin, zero, one, zero, -sin, zero, cos), dim=-1).unflatten(-1, (3, 3))


def look_at_rotation(forward: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Roll-free rotation that sends +z to ``forward``.

    Columns are (right, up, forward): ``right = normalise(e_y x forward)``, ``up = forward x right``.
    Where ``forward`` is vertical the cross product vanishes; there ``right`` is +x, and gradients stay finite.

    Args:
        forward: directions of any positive length.
    """
    forward = F.normalize(forward, dim=-1)
    x, _, z = forward.unbind(-1)
    right = torch.stack((z, torch.zeros_like(x), -x), dim=-1)  # e_y x forward
    parallel = (right.detach().norm(dim=-1) < _PARALLEL)[..., None]
    right = F.normalize(torch.where(parallel, constant((1.0, 0.0, 0.0), forward), right), dim=-1)
    return torch.stack((right, torch.linalg.cross(forward, right), forward), dim=-1)


def azimuth_elevation(
    rotation: Float[Tensor, "*batch 3 3"],
) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch"]]:
    """Direction of the animal's +z axis as the camera sees it.

    Returns:
        azimuth: in (-pi, pi]; 0 faces the camera, positive turns towards the right of the image.
        elevation: in [-pi/2, pi/2]; positive when the head end points above the horizontal plane of the camera.
    """
    x, y, z = rotation[..., 2].unbind(-1)
    return torch.atan2(x, z), torch.asin(y.clamp(-1.0, 1.0))
