"""Edge-driven antialiasing: how silhouettes become differentiable.

A *silhouette edge* has one adjacent face turned to the camera and one turned away, or only one face. Where it crosses
the line between two neighbouring pixel centres, the pixel pair is blended as if the contour were a straight edge
across both: with d the distance of the crossing from the inner pixel's centre and alpha = 1/2 - d,

* alpha > 0: the inner pixel takes the fraction alpha of the outer pixel's colour;
* alpha < 0: the outer pixel takes the fraction -alpha of the inner pixel's colour.

Differentiating alpha through the crossing to both ends of the edge samples the contour integral of the exact
derivative. One sample per unit length suffices: an edge is sampled on pixel rows if it is steeper than 45 degrees,
else on pixel columns (sampling on both would count it twice). Unlike rules that look only at the edges of the triangle
seen at a pixel centre, this finds every contour however small the triangles are.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fauna.renderer.projection import to_pixels, to_screen
from fauna.types import Topology

DEPTH_TOLERANCE = 1e-5  # NDC; a contour in front of a covered pixel must be nearer than it by this much


@dataclass(frozen=True)
class Crossings:
    """Accepted crossings, at most one per pair of neighbouring pixels, ordered by (row, axis, pixel).

    Attributes:
        cell: flat index into (row, axis, height, width): axis 0 pairs (i, j) with (i, j + 1), axis 1 with (i + 1, j).
        edge: index into the topology's edges.
        offset: position of the crossing after the first pixel if that is the inner one, minus 1 if the second is.
    """

    cell: Int[Tensor, " crossing"]
    edge: Int[Tensor, " crossing"]
    offset: Float[Tensor, " crossing"]

    def pixels(self, height: int, width: int) -> tuple[Int[Tensor, " crossing"], Int[Tensor, " crossing"]]:
        """Flat indices into (row, height, width) of the inner and the outer pixels."""
        size = height * width
        axis = self.cell // size % 2
        first = self.cell // (2 * size) * size + self.cell % size
        second = first + torch.where(axis == 0, 1, width)
        inner_first = self.offset >= 0
        return torch.where(inner_first, first, second), torch.where(inner_first, second, first)


@torch.no_grad()
def find_crossings(
    clip_verts: Float[Tensor, "row vert 4"],
    faces: Int[Tensor, "face 3"],
    topology: Topology,
    covered: Bool[Tensor, "row height width"],
    depth: Float[Tensor, "row height width"] | None,
    soft_edges: bool,
) -> Crossings:
    """Where silhouette edges separate neighbouring pixels.

    A pair with exactly one covered pixel accepts every edge. A pair with two covered pixels accepts edges in front of
    the farther one, which is the outer one. Of several edges the one nearest the outer pixel is kept.

    Args:
        clip_verts: homogeneous positions.
        faces: of the mesh.
        topology: edges of the same faces.
        covered: pixels with a triangle.
        depth: NDC depth; ``None`` ignores pairs of two covered pixels, which do not matter to coverage.
        soft_edges: sample both axes.
    """
    _, height, width = covered.shape
    screen = to_screen(clip_verts, height, width, snap=False)
    rows, edges = _silhouette_edges(screen, faces, topology)
    ends = screen[rows[:, None], topology.edges[edges]]  # (candidate, 2, 3)
    span = (ends[:, 1, :2] - ends[:, 0, :2]).abs()
    found = []
    for axis in (0, 1):
        chosen = span[:, 1 - axis] > 0
        if not soft_edges:
            steep = span[:, 1] >= span[:, 0]
            chosen &= steep if axis == 0 else ~steep
        found.append(_cross_lines(axis, rows[chosen], edges[chosen], ends[chosen], covered, depth))
    cell, edge, offset = (torch.cat(parts) for parts in zip(*found, strict=True))
    return _keep_outermost(cell, edge, offset, 2 * covered.numel())


def _silhouette_edges(screen: Tensor, faces: Tensor, topology: Topology) -> tuple[Tensor, Tensor]:
    """Rows and edge indices of the edges between a front and a back face, and of border edges."""
    a, b, c = (screen[:, faces[:, k], :2] for k in range(3))
    front = (b - a)[..., 0] * (c - a)[..., 1] - (b - a)[..., 1] * (c - a)[..., 0] > 0  # (row, face)
    first, second = topology.edge_faces.unbind(1)
    contour = (second < 0) | (front[:, first] != front[:, second.clamp(min=0)])
    visible = screen[:, topology.edges].isfinite().all(dim=-1).all(dim=-1)
    rows, edges = (contour & visible).nonzero(as_tuple=True)
    return rows, edges


def _cross_lines(
    axis: int, rows: Tensor, edges: Tensor, ends: Tensor, covered: Tensor, depth: Tensor | None
) -> tuple[Tensor, Tensor, Tensor]:
    """Cell, edge and offset of accepted crossings with pixel rows (axis 0) or columns (axis 1)."""
    _, height, width = covered.shape
    lines, cells, step = (height, width, 1) if axis == 0 else (width, height, width)
    along, across = ends[..., 1 - axis], ends[..., axis]  # (candidate, 2)
    start = along.amin(1).ceil().clamp(0, lines).long()
    counts = (along.amax(1).ceil().clamp(0, lines).long() - start).clamp(min=0)
    source = torch.repeat_interleave(counts)
    line = torch.arange(len(source), device=rows.device) - (counts.cumsum(0) - counts)[source] + start[source]
    s = (line - along[source, 0]) / (along[source, 1] - along[source, 0])
    position = across[source, 0] + s * (across[source, 1] - across[source, 0])
    inside = (position >= 0) & (position < cells - 1)
    source, line, s, position = source[inside], line[inside], s[inside], position[inside]
    cell = position.floor().long()
    pixel = line * width + cell if axis == 0 else cell * width + line
    first = rows[source] * (height * width) + pixel
    covered_first, covered_second = covered.reshape(-1)[first], covered.reshape(-1)[first + step]
    inner_first, accepted = covered_first, covered_first != covered_second
    if depth is not None:
        near, far = depth.reshape(-1)[first].double(), depth.reshape(-1)[first + step].double()
        edge_depth = ends[source, 0, 2] + s * (ends[source, 1, 2] - ends[source, 0, 2])
        both = covered_first & covered_second
        inner_first = torch.where(both, near < far, covered_first)
        accepted |= both & (near != far) & (edge_depth < torch.maximum(near, far) - DEPTH_TOLERANCE)
    offset = torch.where(inner_first, position - cell, position - cell - 1)
    flat = (2 * rows[source] + axis) * (height * width) + pixel
    return flat[accepted], edges[source][accepted], offset[accepted]


def _keep_outermost(cell: Tensor, edge: Tensor, offset: Tensor, cell_count: int) -> Crossings:
    """Per pair the crossing farthest from the inner pixel, the first edge of equals."""
    farthest = offset.new_full((cell_count,), -1.0).scatter_reduce(0, cell, offset.abs(), "amax")
    keep = offset.abs() == farthest[cell]
    cell, edge, offset = cell[keep], edge[keep], offset[keep]
    lowest = torch.full((cell_count,), torch.iinfo(torch.long).max, device=cell.device)
    lowest = lowest.scatter_reduce(0, cell, edge, "amin")
    keep = edge == lowest[cell]
    cell, order = cell[keep].sort()
    return Crossings(cell, edge[keep][order], offset[keep][order])


def blend_weights(
    crossings: Crossings,
    clip_verts: Float[Tensor, "row vert 4"],
    topology: Topology,
    height: int,
    width: int,
    soft_edges: bool,
) -> Float[Tensor, " crossing"]:
    """Alpha of every crossing, differentiable to ``clip_verts``, float64.

    With ``soft_edges`` alpha is scaled by cos^2 of the angle between the edge's normal and the pair: the two axes'
    weights sum to 1. This factor is a sampling weight and carries no gradient.
    """
    size = height * width
    axis = crossings.cell // size % 2
    row, pixel = crossings.cell // (2 * size), crossings.cell % size
    i, j = pixel // width, pixel % width
    line, cell = torch.where(axis == 0, i, j), torch.where(axis == 0, j, i)
    verts = topology.edges[crossings.edge] + row[:, None] * clip_verts.shape[1]  # (crossing, 2)
    ends = clip_verts.reshape(-1, 4).index_select(0, verts.reshape(-1)).reshape(-1, 2, 4)
    x, y = to_pixels(ends, height, width)
    by_rows = (axis == 0)[:, None]
    along, across = torch.where(by_rows, y, x), torch.where(by_rows, x, y)
    delta_along, delta_across = along[:, 1] - along[:, 0], across[:, 1] - across[:, 0]
    position = across[:, 0] + (line - along[:, 0]) / delta_along * delta_across
    distance = torch.where(crossings.offset >= 0, position - cell, cell + 1 - position)
    alpha = 0.5 - distance
    if soft_edges:
        square = delta_along.detach().square()
        alpha = alpha * (square / (square + delta_across.detach().square()))
    return alpha


def blend(
    image: Float[Tensor, "row chan height width"],
    crossings: Crossings,
    weights: Float[Tensor, " crossing"],
) -> Float[Tensor, "row chan height width"]:
    """Blend pixel pairs across the contour; differentiable to image and weights."""
    rows, channels, height, width = image.shape
    inner, outer = crossings.pixels(height, width)
    target, source = torch.where(weights > 0, inner, outer), torch.where(weights > 0, outer, inner)
    flat = image.movedim(1, -1).reshape(-1, channels)  # (pixel, chan)
    difference = flat.index_select(0, source) - flat.index_select(0, target)
    blended = flat.index_add(0, target, weights.abs().to(image.dtype)[:, None] * difference)
    return blended.reshape(rows, height, width, channels).movedim(-1, 1).contiguous()
