"""Rotation matrices. Column vectors, right-handed, radians; frames are defined in ``docs/conventions.md``.

All functions work on any number of leading axes.
"""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

_PARALLEL = 1e-6
"""Sine of the angle below which a direction counts as parallel to the vertical."""


def euler_xyz_to_matrix(angles: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
    """Intrinsic XYZ Euler angles to ``Rx(a0) Ry(a1) Rz(a2)`` (supplement, "Bone Rotation Prediction").

    Args:
        angles: radians.
    """
    (cx, cy, cz), (sx, sy, sz) = angles.cos().unbind(-1), angles.sin().unbind(-1)
    rows = (
        (cy * cz, -cy * sz, sy),
        (cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy),
        (sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy),
    )
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def rotation_y(angle: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3 3"]:
    """Rotation about the vertical axis; a positive angle (radians) turns +z towards +x."""
    cos, sin, zero, one = angle.cos(), angle.sin(), torch.zeros_like(angle), torch.ones_like(angle)
    rows = ((cos, zero, sin), (zero, one, zero), (-sin, zero, cos))
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


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
    right = F.normalize(torch.where(parallel, forward.new_tensor((1.0, 0.0, 0.0)), right), dim=-1)
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
