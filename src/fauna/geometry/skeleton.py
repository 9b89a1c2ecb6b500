"""Rest bones from the shape alone (supplement, "Adaptive Bone Topology"): eight along the spine, three in each leg.

Indices, directions and leg order are defined in ``docs/conventions.md``, section "Skeleton".
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fauna.errors import FaunaError
from fauna.geometry.constants import constant, constant_index
from fauna.types import Skeleton

NUM_BODY_BONES = 8
NUM_LEGS = 4
BONES_PER_LEG = 3
NUM_BONES = NUM_BODY_BONES + NUM_LEGS * BONES_PER_LEG

LEG_SIDE_X = (1.0, 1.0, -1.0, -1.0)
LEG_SIDE_Z = (1.0, -1.0, -1.0, 1.0)
MIRRORED_LEG = (3, 2, 1, 0)
"""Legs of the other side of the body."""

_BODY_STARTS = (1, 2, 3, 4, 7, 6, 5, 4)
_BODY_ENDS = (0, 1, 2, 3, 8, 7, 6, 5)
_BODY_PARENTS = (1, 2, 3, -1, 5, 6, 7, -1)
_LEG_PARENTS = tuple(NUM_BODY_BONES + BONES_PER_LEG * leg + bone for leg in range(NUM_LEGS) for bone in (1, 2))

MAX_CHAIN = 4 + BONES_PER_LEG
"""Bones on the longest way from a root: half a spine and a leg."""


@dataclass(frozen=True)
class SkeletonOptions:
    """How joints are found on a rest mesh.

    Attributes:
        body_height: spine ends are sought among vertices higher than this below the mean vertex, world units.
        centre_lift: the spine's middle joint lies this high above the mean vertex, world units.
        foot_quantile: share of the vertices, from below, whose extent tells where the legs are.
        margin: width of the gap around the middle in which no foot is sought, relative to their 5-95 % extent.
        foot_origin: what divides left from right and front from rear: the ``median`` or ``mean`` x and z of these
            vertices.
        symmetric_feet: average the feet of both sides, mirrored.
        attachment: ``z_nearest`` = each leg hangs from the spine joint nearest in z, found per instance and shared by
            left and right; or four body bones, one per leg.
    """

    body_height: float
    centre_lift: float
    foot_quantile: float
    margin: float
    foot_origin: Literal["median", "mean"]
    symmetric_feet: bool
    attachment: Literal["z_nearest"] | Sequence[int]

    def __post_init__(self) -> None:
        if self.foot_origin not in ("median", "mean"):
            raise FaunaError(f"skeleton.foot_origin must be median or mean, got {self.foot_origin!r}; choose one")
        if not 0.0 < self.foot_quantile <= 1.0:
            raise FaunaError(f"skeleton.foot_quantile must be in (0, 1], got {self.foot_quantile}; the paper uses 0.4")
        preset = self.attachment
        if isinstance(preset, str):
            valid = preset == "z_nearest"
        else:
            valid = len(preset) == NUM_LEGS and all(0 <= bone < NUM_BODY_BONES for bone in preset)
        if not valid:
            raise FaunaError(
                f"skeleton.attachment must be z_nearest or four body bones in 0..7, got {preset!r}; e.g. [2, 6, 6, 2]"
            )


@torch.no_grad()
def rest_skeleton(verts: Float[Tensor, "batch vert 3"], *, options: SkeletonOptions, legs_attached: bool) -> Skeleton:
    """Place 20 bones in each mesh; meshes of a batch do not influence each other.

    Args:
        verts: rest positions in the canonical frame, world units.
        options: the heuristic's numbers.
        legs_attached: the spine carries the legs; otherwise each leg is a tree of its own.

    Returns:
        Skeleton without gradient. The two halves of the spine are straight and their bones equally long within a half.
    """
    verts = verts.detach().transpose(1, 2).contiguous().transpose(1, 2)  # every axis by itself is read often
    spine = _spine_joints(verts, options)
    feet = _feet(verts, spine, options)
    attachment = _attachment(spine, feet, options)
    body_starts = spine.index_select(1, constant_index(_BODY_STARTS, spine))
    body_ends = spine.index_select(1, constant_index(_BODY_ENDS, spine))
    hips = body_ends.gather(1, attachment[..., None].expand(-1, -1, 3))
    joints = _interpolate(feet, hips, BONES_PER_LEG + 1)  # (batch, leg, 4, 3) from foot to hip
    leg_starts, leg_ends = joints[:, :, 1:].flatten(1, 2), joints[:, :, :-1].flatten(1, 2)
    return Skeleton(
        torch.cat((body_starts, leg_starts), dim=1),
        torch.cat((body_ends, leg_ends), dim=1),
        _parents(attachment, legs_attached),
    )


def _interpolate(
    start: Float[Tensor, "*batch 3"], end: Float[Tensor, "*batch 3"], number: int
) -> Float[Tensor, "*batch number 3"]:
    """Equally spaced points from start to end, both included."""
    steps = constant(tuple((step / (number - 1),) for step in range(number)), start)
    return torch.lerp(start[..., None, :], end[..., None, :], steps)


def _spine_joints(verts: Float[Tensor, "batch vert 3"], options: SkeletonOptions) -> Float[Tensor, "batch 9 3"]:
    """Joints from the +z end over the lifted centre to the -z end, all in the mirror plane."""
    mean = verts.mean(dim=1)
    z = verts[..., 2]
    high = verts[..., 1] > mean[:, 1:2] - options.body_height
    front = torch.where(high, z, -torch.inf).argmax(dim=1)
    rear = torch.where(high, z, torch.inf).argmin(dim=1)
    flat = constant((0.0, 1.0, 1.0), verts)
    front_end, rear_end = _take(verts, front) * flat, _take(verts, rear) * flat
    middle = mean * flat + constant((0.0, options.centre_lift, 0.0), mean)
    return torch.cat((_interpolate(front_end, middle, 5), _interpolate(middle, rear_end, 5)[:, 1:]), dim=1)


def _feet(
    verts: Float[Tensor, "batch vert 3"], spine: Float[Tensor, "batch 9 3"], options: SkeletonOptions
) -> Float[Tensor, "batch leg 3"]:
    """Lowest vertex of each leg's quadrant; if empty, of its quarter of the mesh; if empty, a point below the spine."""
    x, y, z = verts.unbind(-1)
    low = y <= masked_quantiles(y, None, (options.foot_quantile,))
    spread_x = masked_quantiles(x, low, (0.05, 0.5, 0.95))
    spread_z = masked_quantiles(z, low, (0.05, 0.5, 0.95))
    origin_x, origin_z = spread_x[:, 1:2], spread_z[:, 1:2]
    if options.foot_origin == "mean":
        share = low / low.sum(dim=1, keepdim=True)
        origin_x, origin_z = (x * share).sum(dim=1, keepdim=True), (z * share).sum(dim=1, keepdim=True)
    margin_x = options.margin * (spread_x[:, 2:] - spread_x[:, :1])
    margin_z = options.margin * (spread_z[:, 2:] - spread_z[:, :1])
    x_out, z_out = x - origin_x, z - origin_z
    front, rear = z_out > margin_z, z_out < 0  # a gap only in front
    foot, found = _lowest(verts, _quadrants(x_out > margin_x, x_out < -margin_x, front, rear))
    foot_quarter, found_quarter = _lowest(verts, _quadrants(x > 0, x < 0, z_out > 0, rear))
    below = torch.where(found_quarter[..., None], foot_quarter, _points_below(verts, spine))
    feet = torch.where(found[..., None], foot, below)
    if options.symmetric_feet:
        other = feet.index_select(1, constant_index(MIRRORED_LEG, feet)) * constant((-1.0, 1.0, 1.0), feet)
        feet = 0.5 * (feet + other)
    return feet


def _quadrants(
    left: Bool[Tensor, "batch vert"],
    right: Bool[Tensor, "batch vert"],
    front: Bool[Tensor, "batch vert"],
    rear: Bool[Tensor, "batch vert"],
) -> Bool[Tensor, "batch leg vert"]:
    """Vertices on the side (left = +x) and at the end (front = +z) of each leg."""
    return torch.stack((left & front, left & rear, right & rear, right & front), dim=1)


def _points_below(
    verts: Float[Tensor, "batch vert 3"], spine: Float[Tensor, "batch 9 3"]
) -> Float[Tensor, "batch leg 3"]:
    """At a quarter of the width, at the height of the lowest vertex, below the middle of each half-spine."""
    lowest, highest = verts.amin(dim=1), verts.amax(dim=1)
    quarter = 0.25 * (highest[:, :1] - lowest[:, :1])
    x = quarter * constant(LEG_SIDE_X, verts)
    z = torch.where(constant(LEG_SIDE_Z, verts) > 0, spine[:, 2, 2:], spine[:, 6, 2:])
    return torch.stack((x, lowest[:, 1:2].expand_as(x), z), dim=-1)


def _attachment(
    spine: Float[Tensor, "batch 9 3"], feet: Float[Tensor, "batch leg 3"], options: SkeletonOptions
) -> Int[Tensor, "batch leg"]:
    """Body bone at whose end each leg hangs; the centre joint is no bone's end and so never taken."""
    if not isinstance(options.attachment, str):
        return constant_index(tuple(options.attachment), feet).expand(feet.shape[0], -1)
    ends = spine[..., 2].index_select(1, constant_index(_BODY_ENDS, spine))  # (batch, body bone)
    nearest = (ends[:, None] - feet[:, :2, 2:]).abs().argmin(dim=-1)  # legs 0 and 1
    return torch.cat((nearest, nearest.flip(1)), dim=1)


def _parents(attachment: Int[Tensor, "batch leg"], legs_attached: bool) -> Int[Tensor, "batch bone"]:
    """Parent of every bone, -1 at a root."""
    body = constant_index(_BODY_PARENTS, attachment).expand(attachment.shape[0], -1)
    legs = constant_index(_LEG_PARENTS, attachment).expand(attachment.shape[0], -1).unflatten(1, (NUM_LEGS, 2))
    hips = attachment if legs_attached else torch.full_like(attachment, -1)
    return torch.cat((body, torch.cat((legs, hips[..., None]), dim=-1).flatten(1)), dim=1)


def _take(verts: Float[Tensor, "batch vert 3"], index: Int[Tensor, " batch"]) -> Float[Tensor, "batch 3"]:
    return verts.gather(1, index[:, None, None].expand(-1, 1, 3))[:, 0]


def _lowest(
    verts: Float[Tensor, "batch vert 3"], mask: Bool[Tensor, "batch leg vert"]
) -> tuple[Float[Tensor, "batch leg 3"], Bool[Tensor, "batch leg"]]:
    """Lowest vertex of each masked set, and whether the set has any."""
    height = torch.where(mask, verts[:, None, :, 1], torch.inf)
    index = height.argmin(dim=-1, keepdim=True)
    return verts.gather(1, index.expand(-1, -1, 3)), mask.gather(-1, index)[..., 0]


def masked_quantiles(
    values: Float[Tensor, "batch vert"], mask: Bool[Tensor, "batch vert"] | None, quantiles: tuple[float, ...]
) -> Float[Tensor, "batch quantile"]:
    """Linearly interpolated quantiles over the masked entries of each item, at least one; ``None`` = over all."""
    if mask is None:
        last = torch.full_like(values[:, :1], values.shape[1] - 1, dtype=torch.int64)
    else:
        values, last = torch.where(mask, values, torch.inf), mask.sum(dim=1, keepdim=True) - 1
    ordered = _ascending(values)
    place = last * constant(quantiles, values)  # (batch, quantile), fractional ranks
    below = place.floor().long()
    above = torch.minimum(below + 1, last)
    return torch.lerp(ordered.gather(1, below), ordered.gather(1, above), place - below)


def _ascending(values: Float[Tensor, "batch vert"]) -> Float[Tensor, "batch vert"]:
    """Each row sorted. ``torch.sort`` also returns the order, which makes it 30 times slower than numpy on a CPU."""
    if values.device.type != "cpu":
        return values.sort(dim=1).values
    return torch.from_numpy(np.sort(values.numpy(), axis=1))
