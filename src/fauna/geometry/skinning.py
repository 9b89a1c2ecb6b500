"""Linear blend skinning (supplement, "Skinning Weights"), bone-major so that every inner loop is long."""

import math
from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn import functional as F

from fauna.errors import FaunaError
from fauna.geometry.blend import BlendedMotion, vertex_blocks
from fauna.geometry.constants import constant
from fauna.geometry.rotations import euler_xyz_to_matrix
from fauna.geometry.rows import per_row, rows_per_item
from fauna.geometry.skeleton import MAX_CHAIN
from fauna.types import Skeleton

SkinDistance = Literal["euclidean", "squared"]
_FLOOR = 1e-6
"""Smallest squared bone length and offset under the root of a distance, world units squared."""

_ROUNDS = math.ceil(math.log2(MAX_CHAIN))
"""Rounds of pointer doubling that reach the root of every chain."""


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
    columns, segments, length = _columns(verts, skeleton), _segments(skeleton), _squared_length(skeleton)
    items, bones = max(verts.shape[0], segments.shape[0]), skeleton.starts.shape[1]
    weights = verts.new_empty(items, bones, verts.shape[1])
    for block in vertex_blocks(verts.shape[1], 3 * items * bones, verts.device):
        squared = _squared_distance(columns[..., block], segments, length)
        if distance == "euclidean":
            squared = squared.add_(_FLOOR).sqrt_()
        weights[..., block] = squared.mul_(-1.0 / temperature).softmax(dim=1)
    return weights.transpose(1, 2)


def squared_distance_to_bones(
    verts: Float[Tensor, "#batch vert 3"], skeleton: Skeleton
) -> Float[Tensor, "batch bone vert"]:
    """Squared distance of every vertex to every bone segment, world units squared.

    With ``p = v - start``, ``u = end - start`` and ``s = p.u / |u|^2`` clamped to ``t`` in [0, 1],
    ``|p - t u|^2 = |p|^2 + |u|^2 t (t - 2 s)``; ``s`` and ``|p|^2`` come out of one matrix product.
    """
    return _squared_distance(_columns(verts, skeleton), _segments(skeleton), _squared_length(skeleton))


def _columns(verts: Float[Tensor, "#batch vert 3"], skeleton: Skeleton) -> Float[Tensor, "batch 5 vert"]:
    """x, y, z from the skeleton's centre (so that less cancels), |v|^2 and 1 of each vertex."""
    columns = (verts - skeleton.starts.mean(dim=1, keepdim=True)).transpose(1, 2)
    return torch.cat((columns, columns.square().sum(1, keepdim=True), torch.ones_like(columns[:, :1])), dim=1)


def _segments(skeleton: Skeleton) -> Float[Tensor, "batch bone2 5"]:
    """Matrix from :func:`_columns` to ``s`` of all bones, then ``|p|^2`` of all bones."""
    starts = skeleton.starts - skeleton.starts.mean(dim=1, keepdim=True)
    bones = skeleton.ends - skeleton.starts
    along = bones / _squared_length(skeleton)
    zero, one = torch.zeros_like(along[..., :1]), torch.ones_like(along[..., :1])
    places = torch.cat((along, zero, -(along * starts).sum(-1, keepdim=True)), dim=-1)
    squares = torch.cat((-2.0 * starts, one, starts.square().sum(-1, keepdim=True)), dim=-1)
    return torch.cat((places, squares), dim=1)


def _squared_length(skeleton: Skeleton) -> Float[Tensor, "batch bone 1"]:
    return (skeleton.ends - skeleton.starts).square().sum(-1, keepdim=True).clamp_min(_FLOOR)


def _squared_distance(
    columns: Float[Tensor, "#batch 5 vert"],
    segments: Float[Tensor, "#batch bone2 5"],
    length: Float[Tensor, "#batch bone 1"],
) -> Float[Tensor, "batch bone vert"]:
    place, squared = (segments @ columns).chunk(2, dim=1)  # views of a tensor of our own
    clamped = place.clamp(0.0, 1.0)
    shortening = place.mul_(-2.0).add_(clamped).mul_(clamped).mul_(length)
    return squared.add_(shortening).clamp_min_(0.0)


def rest_frames(skeleton: Skeleton) -> Float[Tensor, "batch bone 3 3"]:
    """Rest orientation of each bone, columns (right, up, forward), as in ``docs/conventions.md``.

    ``forward`` is the bone's direction, ``up = normalise(forward x e_x)``, ``right = up x forward``. A bone along x
    takes ``up = e_y``; one of zero length takes ``forward = e_z``.
    """
    bones = skeleton.ends - skeleton.starts
    length = bones.norm(dim=-1, keepdim=True)
    forward = torch.where(length > 1e-8, bones / length.clamp_min(1e-8), constant((0.0, 0.0, 1.0), bones))
    _, y, z = forward.unbind(-1)
    up = torch.stack((torch.zeros_like(y), z, -y), dim=-1)
    length = up.norm(dim=-1, keepdim=True)
    up = torch.where(length > 1e-4, up / length.clamp_min(1e-4), constant((0.0, 1.0, 0.0), bones))
    right = F.normalize(torch.linalg.cross(up, forward), dim=-1)
    return torch.stack((right, torch.linalg.cross(forward, right), forward), dim=-1)


def bone_transforms(skeleton: Skeleton, angles: Float[Tensor, "row bone 3"]) -> Float[Tensor, "row bone 4 4"]:
    """Rigid transforms that carry rest positions to posed ones, along the bone tree (supplement, "Skinning Weights").

    Bone b moves by ``G_root ... G_parent G_b`` with ``G = B R(angles) B^-1`` and ``B`` its rest frame at its start
    joint; all angles zero give the identity.

    Args:
        skeleton: rest bones of each photo, or one for all; rows are photo-major.
        angles: Euler XYZ in the bone's rest frame, radians.
    """
    frames, starts = rest_frames(skeleton)[:, None], skeleton.starts[:, None, :, :, None]  # (photo, 1, bone, 3, 3 or 1)
    turns = euler_xyz_to_matrix(_by_item(angles, skeleton))
    rotation = frames @ turns @ frames.transpose(-1, -2)
    upper = torch.cat((rotation, starts - rotation @ starts), dim=-1).flatten(0, 1)
    bottom = constant((0.0, 0.0, 0.0, 1.0), upper).expand(*upper.shape[:-2], 1, 4)
    return _compose_ancestors(torch.cat((upper, bottom), dim=-2), per_row(skeleton.parents, angles.shape[0]))


def _by_item(values: Tensor, skeleton: Skeleton) -> Tensor:
    """Split the rows' axis into (photo or 1, rows of it)."""
    items = skeleton.starts.shape[0]
    return values.unflatten(0, (items, rows_per_item(values.shape[0], items)))


def _compose_ancestors(
    local: Float[Tensor, "row bone 4 4"], parents: Int[Tensor, "row bone"]
) -> Float[Tensor, "row bone 4 4"]:
    """Product of each bone's ancestors, root first, and itself, in rounds of pointer doubling.

    After round k a bone holds the product of its nearest 2^k ancestors (itself included) and points past them. An
    extra bone with the identity, its own parent, stands above the roots. The number of rounds is that of the longest
    chain a skeleton can have, so nobody has to look at ``parents``.
    """
    rows, bones = parents.shape
    identity = constant(tuple(tuple(float(i == j) for j in range(4)) for i in range(4)), local)
    product = torch.cat((local, identity.expand(rows, 1, 4, 4)), dim=1)
    above = torch.cat((parents, torch.full_like(parents[:, :1], bones)), dim=1)  # (row, bone + 1)
    above = torch.where(above < 0, bones, above)
    for round_ in range(_ROUNDS):
        product = product.gather(1, above[..., None, None].expand(-1, -1, 4, 4)) @ product
        above = above.gather(1, above) if round_ + 1 < _ROUNDS else above
    return product[:, :bones]


def skin(
    verts: Float[Tensor, "instance vert 3"],
    weights: Float[Tensor, "item vert bone"],
    transforms: Float[Tensor, "row bone 4 4"],
) -> Float[Tensor, "row vert 3"]:
    """Move vertices by the weighted mean of the bones' matrices: ``v' = (sum_b w_b T_b) v``.

    Args:
        verts: rest positions of each photo, or one for all; receive gradient.
        weights: rows summing to 1, of each photo, or one for all; constant.
        transforms: of :func:`bone_transforms`, rows photo-major; receive gradient.

    Returns:
        Posed positions, differentiable once.

    Raises:
        ValueError: when photos cannot have equally many rows.
    """
    rows, bones = transforms.shape[:2]
    photos = max(verts.shape[0], weights.shape[0])
    columns = transforms[:, :, :3, :].permute(0, 3, 2, 1).reshape(rows, 12, bones)  # column-major 3 x 4
    columns = columns.unflatten(0, (photos, rows_per_item(rows, photos)))
    return BlendedMotion.apply(verts, columns, weights.detach().transpose(1, 2)).flatten(0, 1)


def posed_bones(
    skeleton: Skeleton, transforms: Float[Tensor, "row bone 4 4"]
) -> tuple[Float[Tensor, "row bone 3"], Float[Tensor, "row bone 3"]]:
    """Start and end joints after posing, each moved with its own bone; rows are photo-major."""
    joints = torch.stack((skeleton.starts, skeleton.ends), dim=-1)[:, None]  # (photo, 1, bone, 3, joint)
    matrix = _by_item(transforms, skeleton)
    starts, ends = (matrix[..., :3, :3] @ joints + matrix[..., :3, 3:]).flatten(0, 1).unbind(-1)
    return starts, ends
