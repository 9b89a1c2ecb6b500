"""Linear blend skinning (supplement, "Skinning Weights"), bone-major so that every inner loop is long."""

from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fauna.errors import FaunaError
from fauna.geometry.rotations import euler_xyz_to_matrix
from fauna.types import Skeleton

SkinDistance = Literal["euclidean", "squared"]
_FLOOR = 1e-6
"""Smallest squared bone length and offset under the root of a distance, world units squared."""


@torch.no_grad()
def skinning_weights(
    verts: Float[Tensor, "#batch vert 3"], skeleton: Skeleton, *, temperature: float, distance: SkinDistance
) -> Float[Tensor, "batch vert bone"]:
    """``softmax_b(-d(v, bone b) / temperature)`` over all bones, without gradient.

    Args:
        verts: rest positions, world units.
        skeleton: rest bones; vertices or bones with a leading axis of 1 are shared by the batch.
        temperature: tau_s, in the unit of ``distance``.
        distance: ``squared`` distance to the bone segment (the paper's formula) or ``euclidean`` (the published code).

    Raises:
        FaunaError: for an unknown distance or a temperature that is not positive.
    """
    if distance not in ("euclidean", "squared"):
        raise FaunaError(f"rig.skin_distance must be euclidean or squared, got {distance!r}; choose one")
    if not temperature > 0:
        raise FaunaError(f"rig.skin_temperature must be > 0, got {temperature}; the paper uses 0.5, its code 0.05")
    squared = squared_distance_to_bones(verts, skeleton)
    if distance == "euclidean":
        squared = squared.add_(_FLOOR).sqrt_()
    return squared.mul_(-1.0 / temperature).softmax(dim=1).transpose(1, 2)


def squared_distance_to_bones(
    verts: Float[Tensor, "#batch vert 3"], skeleton: Skeleton
) -> Float[Tensor, "batch bone vert"]:
    """Squared distance of every vertex to every bone segment, world units squared.

    With ``p = v - start``, ``u = end - start`` and ``s = p.u / |u|^2`` clamped to ``t`` in [0, 1],
    ``|p - t u|^2 = |p|^2 + |u|^2 t (t - 2 s)``; ``s`` and ``|p|^2`` come out of one matrix product each.
    """
    centre = skeleton.starts.mean(dim=1, keepdim=True)  # less cancellation in |p|^2
    verts, starts = verts - centre, skeleton.starts - centre
    bones = skeleton.ends - skeleton.starts
    length = bones.square().sum(-1, keepdim=True).clamp_min(_FLOOR)  # (batch, bone, 1)
    columns = verts.transpose(1, 2).contiguous()  # (batch, 3, vert)
    along = bones / length
    place = (along @ columns).sub_((along * starts).sum(-1, keepdim=True))  # s
    squared = (starts @ columns).mul_(-2.0).add_(starts.square().sum(-1, keepdim=True))
    squared.add_(columns.square().sum(1, keepdim=True))  # |p|^2
    clamped = place.clamp(0.0, 1.0)
    return squared.add_(place.mul_(-2.0).add_(clamped).mul_(clamped).mul_(length)).clamp_min_(0.0)


def rest_frames(skeleton: Skeleton) -> Float[Tensor, "batch bone 3 3"]:
    """Rest orientation of each bone, columns (right, up, forward), as in ``docs/conventions.md``.

    ``forward`` is the bone's direction, ``up = normalise(forward x e_x)``, ``right = up x forward``. A bone along x
    takes ``up = e_y``; one of zero length takes ``forward = e_z``.
    """
    bones = skeleton.ends - skeleton.starts
    length = bones.norm(dim=-1, keepdim=True)
    forward = torch.where(length > 1e-8, bones / length.clamp_min(1e-8), bones.new_tensor((0.0, 0.0, 1.0)))
    _, y, z = forward.unbind(-1)
    up = torch.stack((torch.zeros_like(y), z, -y), dim=-1)
    length = up.norm(dim=-1, keepdim=True)
    up = torch.where(length > 1e-4, up / length.clamp_min(1e-4), bones.new_tensor((0.0, 1.0, 0.0)))
    right = torch.nn.functional.normalize(torch.linalg.cross(up, forward), dim=-1)
    return torch.stack((right, torch.linalg.cross(forward, right), forward), dim=-1)


def bone_transforms(skeleton: Skeleton, angles: Float[Tensor, "row bone 3"]) -> Float[Tensor, "row bone 4 4"]:
    """Rigid transforms that carry rest positions to posed ones, along the bone tree (supplement, "Skinning Weights").

    Bone b moves by ``G_root ... G_parent G_b`` with ``G = B R(angles) B^-1`` and ``B`` its rest frame at its start
    joint; all angles zero give the identity.

    Args:
        skeleton: rest bones, of each row or one for all.
        angles: Euler XYZ in the bone's rest frame, radians.
    """
    frames = rest_frames(skeleton)
    rotation = frames @ euler_xyz_to_matrix(angles) @ frames.transpose(-1, -2)
    shift = skeleton.starts - (rotation @ skeleton.starts[..., None])[..., 0]
    upper = torch.cat((rotation, shift[..., None]), dim=-1)
    bottom = upper.new_tensor((0.0, 0.0, 0.0, 1.0)).expand(*upper.shape[:-2], 1, 4)
    parents = skeleton.parents.expand(angles.shape[0], -1)
    return _compose_ancestors(torch.cat((upper, bottom), dim=-2), parents)


def _compose_ancestors(
    local: Float[Tensor, "row bone 4 4"], parents: Int[Tensor, "row bone"]
) -> Float[Tensor, "row bone 4 4"]:
    """Product of each bone's ancestors, root first, and itself, in log2(depth) rounds of pointer doubling.

    After round k a bone holds the product of its nearest 2^k ancestors (itself included) and points past them.
    An extra bone with the identity, its own parent, stands above the roots.
    """
    rows, bones = parents.shape
    identity = torch.eye(4, dtype=local.dtype, device=local.device).expand(rows, 1, 4, 4)
    product = torch.cat((local, identity), dim=1)
    top = torch.full_like(parents[:, :1], bones)
    above = torch.cat((torch.where(parents < 0, bones, parents), top), dim=1)  # (row, bone + 1)
    while bool((above < bones).any()):
        product = product.gather(1, above[..., None, None].expand(-1, -1, 4, 4)) @ product
        above = above.gather(1, above)
    return product[:, :bones]


def skin(
    verts: Float[Tensor, "#row vert 3"],
    weights: Float[Tensor, "#row vert bone"],
    transforms: Float[Tensor, "row bone 4 4"],
) -> Float[Tensor, "row vert 3"]:
    """Move vertices by the weighted mean of the bones' matrices: ``v' = (sum_b w_b T_b) v``.

    Args:
        verts: rest positions; receive gradient.
        weights: rows summing to 1; vertices or weights with a leading axis of 1 are shared by all rows.
        transforms: of :func:`bone_transforms`; receive gradient.
    """
    rows, bones = transforms.shape[:2]
    flat = transforms[:, :, :3, :].permute(0, 3, 2, 1).reshape(rows, 12, bones)  # column-major 3 x 4
    blended = (flat @ weights.transpose(1, 2)).reshape(rows, 4, 3, -1)  # (row, column, coordinate, vert)
    moved = (blended[:, :3] * verts.transpose(1, 2)[:, :, None]).sum(1) + blended[:, 3]
    return moved.transpose(1, 2).contiguous()


def posed_bones(
    skeleton: Skeleton, transforms: Float[Tensor, "row bone 4 4"]
) -> tuple[Float[Tensor, "row bone 3"], Float[Tensor, "row bone 3"]]:
    """Start and end joints after posing, each moved with its own bone."""
    rotation, shift = transforms[..., :3, :3], transforms[..., :3, 3]
    starts = (rotation @ skeleton.starts[..., None])[..., 0] + shift
    ends = (rotation @ skeleton.ends[..., None])[..., 0] + shift
    return starts, ends
