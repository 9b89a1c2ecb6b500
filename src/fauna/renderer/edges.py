"""Edge-driven antialiasing: how silhouettes become differentiable.

A *silhouette edge* has one adjacent face turned to the camera and one turned away, or only one face. Where it crosses
the line between two neighbouring pixel centres, the contour is taken as a straight line across both pixels, of the
edge's slope m (how far it moves along the pair per pixel across it, limited to 1). With f(t) the part of a pixel
beyond such a line at the distance t from its centre (:func:`beyond`) and d the distance of the crossing from the inner
pixel's centre,

* the inner pixel takes the fraction f(d) of the outer pixel's colour,
* the outer pixel takes the fraction f(1 - d) of the inner pixel's colour.

This is the exact coverage of a straight contour. Edges are sampled on pixel rows *and* columns, and the two samples
weighted with 1 / (1 + m^4): the weights of both directions sum to 1, and the direction the edge is steeper to counts
most. Differentiating both fractions through the crossing to the ends of the edge samples the contour integral of the
exact derivative of coverage: f'(d) + f'(1 - d) = -1, so every unit of contour counts once. Slope and weight describe
the sampling and carry no gradient: they do not change under translation and scaling, and for edges shorter than a
pixel their derivative is noise. A part of the mesh thinner than a pixel is seen only where it covers a pixel centre: its
coverage and gradient are too small by about its width. Unlike rules that look only at the edges of the triangle seen at a pixel centre, this
finds every contour however small the triangles are.
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
        slope: |d(position) / d(line)| of the edge.
    """

    cell: Int[Tensor, " crossing"]
    edge: Int[Tensor, " crossing"]
    offset: Float[Tensor, " crossing"]
    slope: Float[Tensor, " crossing"]

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
    """
    _, height, width = covered.shape
    rows, edges = _silhouette_edges(clip_verts, faces, topology)
    ends = to_screen(clip_verts[rows[:, None], topology.edges[edges]], height, width, snap=False)  # (candidate, 2, 3)
    valid = ends.isfinite().all(dim=2).all(dim=1)
    span = (ends[:, 1, :2] - ends[:, 0, :2]).abs()
    found = []
    for axis in (0, 1):
        chosen = (valid & (span[:, 1 - axis] > 0)).nonzero().squeeze(1)
        found.append(_cross_lines(axis, rows[chosen], edges[chosen], ends[chosen], covered, depth))
    crossings = Crossings(*(torch.cat(parts) for parts in zip(*found, strict=True)))
    return _keep_outermost(crossings, 2 * covered.numel())


def _silhouette_edges(clip_verts: Tensor, faces: Tensor, topology: Topology) -> tuple[Tensor, Tensor]:
    """Rows and edge indices of the edges between a front and a back face, and of border edges.

    The sign of a face's area on the screen is that of the determinant of its corners' (X, Y, W).
    """
    x, y, w = (clip_verts[..., k].double()[:, faces].unbind(-1) for k in (0, 1, 3))  # each: 3 x (row, face)
    determinant = (
        x[0] * (y[1] * w[2] - w[1] * y[2]) - y[0] * (x[1] * w[2] - w[1] * x[2]) + w[0] * (x[1] * y[2] - y[1] * x[2])
    )
    front = determinant > 0
    first, second = topology.edge_faces.unbind(1)
    contour = (second < 0) | (front[:, first] != front[:, second.clamp(min=0)])
    rows, edges = contour.nonzero(as_tuple=True)
    return rows, edges


def _cross_lines(
    axis: int, rows: Tensor, edges: Tensor, ends: Tensor, covered: Tensor, depth: Tensor | None
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Cell, edge, offset and slope of accepted crossings with pixel rows (axis 0) or columns (axis 1)."""
    _, height, width = covered.shape
    lines, cells, step = (height, width, 1) if axis == 0 else (width, height, width)
    along, across = ends[..., 1 - axis], ends[..., axis]  # (candidate, 2)
    start = along.amin(1).ceil().clamp(0, lines).long()
    counts = (along.amax(1).ceil().clamp(0, lines).long() - start).clamp(min=0)
    source = torch.repeat_interleave(counts)
    line = torch.arange(len(source), device=rows.device) - (counts.cumsum(0) - counts)[source] + start[source]
    delta_along, delta_across = along[:, 1] - along[:, 0], across[:, 1] - across[:, 0]
    s = (line - along[source, 0]) / delta_along[source]
    position = across[source, 0] + s * delta_across[source]
    inside = ((position >= 0) & (position < cells - 1)).nonzero().squeeze(1)
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
    slope = (delta_across / delta_along).abs()[source]
    kept = accepted.nonzero().squeeze(1)
    return flat[kept], edges[source[kept]], offset[kept], slope[kept]


def _keep_outermost(found: Crossings, cell_count: int) -> Crossings:
    """Per pair the crossing farthest from the inner pixel, the first edge of equals."""
    cell, edge, extent = found.cell, found.edge, found.offset.abs()
    farthest = extent.new_full((cell_count,), -1.0).scatter_reduce(0, cell, extent, "amax")
    lowest_of_none = torch.iinfo(torch.long).max
    lowest = torch.full((cell_count,), lowest_of_none, device=cell.device)
    lowest = lowest.scatter_reduce(0, cell, edge.masked_fill(extent < farthest[cell], lowest_of_none), "amin")
    keep = ((edge == lowest[cell]) & (extent == farthest[cell])).nonzero().squeeze(1)
    order = keep[cell[keep].argsort()]
    return Crossings(cell[order], edge[order], found.offset[order], found.slope[order])


def distances(
    crossings: Crossings,
    clip_verts: Float[Tensor, "row vert 4"],
    topology: Topology,
    height: int,
    width: int,
) -> Float[Tensor, " crossing"]:
    """From the inner pixel's centre to the crossing, in [0, 1] pixels; float64, differentiable to ``clip_verts``."""
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
    position = across[:, 0] + (line - along[:, 0]) / (along[:, 1] - along[:, 0]) * (across[:, 1] - across[:, 0])
    return torch.where(crossings.offset >= 0, position - cell, cell + 1 - position)


def beyond(distance: Float[Tensor, " crossing"], slope: Float[Tensor, " crossing"]) -> Float[Tensor, " crossing"]:
    """Part of a pixel beyond a straight line.

    Args:
        distance: of the line from the pixel's centre along a pixel axis, pixels, >= 0.
        slope: tangent of the angle between the line and the other axis, in [0, 1].

    Returns:
        1/2 - t up to t = (1 - m) / 2, then a parabola that reaches 0 at t = (1 + m) / 2.
    """
    near, far = 0.5 * (1 - slope), 0.5 * (1 + slope)
    corner = 0.5 * (far - distance).clamp(min=0).square() / torch.where(slope > 0, slope, 1)
    return torch.where(distance <= near, 0.5 - distance, corner)


def shares(
    crossings: Crossings, distance: Float[Tensor, " crossing"]
) -> tuple[Float[Tensor, " crossing"], Float[Tensor, " crossing"]]:
    """What the inner pixel takes of the outer one, and the outer of the inner one."""
    weight, slope = 1 / (1 + crossings.slope**4), crossings.slope.clamp(max=1)
    return weight * beyond(distance, slope), weight * beyond(1 - distance, slope)


def blend(
    image: Float[Tensor, "row chan height width"],
    crossings: Crossings,
    distance: Float[Tensor, " crossing"],
) -> Float[Tensor, "row chan height width"]:
    """Blend pixel pairs across the contour; differentiable to image and distances."""
    rows, channels, height, width = image.shape
    inner, outer = crossings.pixels(height, width)
    loss, gain = shares(crossings, distance)
    flat = image.movedim(1, -1).reshape(-1, channels)  # (pixel, chan)
    step = flat.index_select(0, outer) - flat.index_select(0, inner)
    changes = torch.cat((loss.to(image.dtype)[:, None] * step, -gain.to(image.dtype)[:, None] * step))
    blended = flat.index_add(0, torch.cat((inner, outer)), changes)
    return blended.reshape(rows, height, width, channels).movedim(-1, 1).contiguous()
