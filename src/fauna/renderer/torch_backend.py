"""The readable reference backend: vectorised torch, any device with float64.

No loop runs over images, nothing is copied from the host, and every operation is deterministic or has a deterministic
form (``torch.use_deterministic_algorithms``). What remains to wait for on a GPU are the sizes that depend on the data:
of triangles with pixels, of samples and of hits in :func:`nearest_faces`; of covered pixels, once for the barycentrics
and once in each dense interpolation; of silhouette edges, of crossings before and after selection for each axis, and
of kept crossings in ``fauna.renderer.edges``; and the bounds of a new mesh's indices, once.
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fauna.renderer.base import Renderer
from fauna.renderer.checks import check_attributes, check_mesh, check_topology
from fauna.renderer.contour import Contour
from fauna.renderer.edges import blend, distances, find_crossings, shares
from fauna.renderer.projection import to_screen
from fauna.types import Fragments, Topology

MIN_AREA2 = 2.0**-20  # twice the area in px^2 below which a triangle is treated as seen edge-on
CHUNK = 1 << 22  # pixel centres tested at a time: bounds the memory when triangles are large


class TorchRenderer(Renderer):
    """Rasteriser in plain torch operations."""

    def rasterize(
        self, clip_verts: Float[Tensor, "row vert 4"], faces: Int[Tensor, "face 3"], height: int, width: int
    ) -> Fragments:
        """See :meth:`Renderer.rasterize`."""
        check_mesh(clip_verts, faces, height, width)
        face_index, depth = nearest_faces(clip_verts, faces, height, width)
        return Fragments(face_index, barycentrics(clip_verts, faces, face_index), depth.to(clip_verts.dtype))

    def interpolate(
        self,
        fragments: Fragments,
        faces: Int[Tensor, "face 3"],
        attributes: Float[Tensor, "row_or_1 vert chan"],
    ) -> Float[Tensor, "row chan height width"]:
        """See :meth:`Renderer.interpolate`."""
        rows, height, width = fragments.face_index.shape
        pixels = fragments.covered.reshape(-1).nonzero().squeeze(1)
        values = self.interpolate_at(fragments, faces, attributes, pixels)
        image = values.new_zeros(rows * height * width, values.shape[1]).index_copy(0, pixels, values)
        return image.reshape(rows, height, width, attributes.shape[2]).movedim(-1, 1).contiguous()

    def interpolate_at(
        self,
        fragments: Fragments,
        faces: Int[Tensor, "face 3"],
        attributes: Float[Tensor, "row_or_1 vert chan"],
        pixels: Int[Tensor, " pixel"],
    ) -> Float[Tensor, "pixel chan"]:
        """See :meth:`Renderer.interpolate_at`."""
        attributes = check_attributes(fragments, faces, attributes)
        sets, verts, channels = attributes.shape
        face = fragments.face_index.reshape(-1)[pixels]
        weights = fragments.barycentrics.reshape(-1, 3).index_select(0, pixels)
        if not len(faces):
            return weights.new_zeros(len(pixels), channels)
        _, height, width = fragments.face_index.shape
        row = (pixels // (height * width)).clamp(max=sets - 1)
        corners = faces[face.clamp(min=0)] + (row * verts)[:, None]  # (pixel, 3); background has weights 0
        values = attributes.reshape(-1, channels).index_select(0, corners.reshape(-1)).reshape(-1, 3, channels)
        return (weights[..., None] * values).sum(dim=1)

    def antialias(
        self,
        image: Float[Tensor, "row chan height width"],
        fragments: Fragments,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        topology: Topology,
    ) -> Float[Tensor, "row chan height width"]:
        """See :meth:`Renderer.antialias`."""
        check_topology(topology, clip_verts, faces)
        crossings = find_crossings(clip_verts, faces, topology, fragments.covered, fragments.depth)
        return blend(image, crossings, distances(crossings, clip_verts, topology, *image.shape[-2:]))

    def contour(
        self,
        fragments: Fragments,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        topology: Topology,
    ) -> Contour:
        """See :meth:`Renderer.contour`."""
        check_topology(topology, clip_verts, faces)
        _, height, width = fragments.face_index.shape
        crossings = find_crossings(clip_verts, faces, topology, fragments.covered, fragments.depth)
        inner, outer = crossings.pixels(height, width)
        loss, gain = shares(crossings, distances(crossings, clip_verts, topology, height, width))
        return Contour(torch.cat((inner, outer)), torch.cat((outer, inner)), torch.cat((loss, gain)))

    def silhouette(
        self,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        height: int,
        width: int,
        topology: Topology,
    ) -> Float[Tensor, "row height width"]:
        """See :meth:`Renderer.silhouette`."""
        check_mesh(clip_verts, faces, height, width)
        check_topology(topology, clip_verts, faces)
        covered = nearest_faces(clip_verts, faces, height, width)[0] >= 0
        crossings = find_crossings(clip_verts, faces, topology, covered, None)
        distance = distances(crossings, clip_verts, topology, height, width)
        return blend(covered[:, None].to(clip_verts.dtype), crossings, distance).squeeze(1).clamp(0, 1)


@torch.no_grad()
def nearest_faces(
    clip_verts: Float[Tensor, "row vert 4"], faces: Int[Tensor, "face 3"], height: int, width: int
) -> tuple[Int[Tensor, "row height width"], Float[Tensor, "row height width"]]:
    """Index of the nearest face at every pixel centre (-1 for none) and its NDC depth in float64 (+inf for none).

    All pixel centres in the bounding box of every triangle are tested against its three edge functions, in chunks.
    """
    rows = clip_verts.shape[0]
    corners = to_screen(clip_verts, height, width, snap=True)[:, faces]  # (row, face, 3, 3)
    low, high = corners[..., :2].amin(2).ceil(), corners[..., :2].amax(2).floor()  # (row, face, 2)
    first = torch.stack((low[..., 0].clamp(0, width), low[..., 1].clamp(0, height)), dim=-1).nan_to_num(0)
    last = torch.stack((high[..., 0].clamp(max=width - 1), high[..., 1].clamp(max=height - 1)), dim=-1)
    extent = (torch.maximum(last, first - 1).nan_to_num(-1) - first + 1).long()
    area = _cross(corners[..., 1, :2] - corners[..., 0, :2], corners[..., 2, :2] - corners[..., 0, :2])
    counts = (extent[..., 0] * extent[..., 1]) * (area.abs() > MIN_AREA2)
    row, face = counts.nonzero(as_tuple=True)
    counts, extent, first = counts[row, face], extent[row, face], first[row, face].long()
    corners, area = corners[row, face], area[row, face]

    depth = corners.new_full((rows * height * width,), torch.inf)
    nearest = torch.full_like(depth, -1, dtype=torch.long)
    for part, samples in _chunks(counts):
        triangle = torch.repeat_interleave(counts[part], output_size=samples) + part.start
        index = torch.arange(len(triangle), device=faces.device)
        index = index - (counts[part].cumsum(0) - counts[part])[triangle - part.start]
        j = first[triangle, 0] + index % extent[triangle, 0]
        i = first[triangle, 1] + index // extent[triangle, 0]
        z, hit = _test_centres(corners[triangle], area[triangle], torch.stack((j, i), dim=1))
        hit = hit.nonzero().squeeze(1)
        pixel = ((row[triangle] * height + i) * width + j)[hit]
        _keep_nearest(depth, nearest, pixel, z[hit], face[triangle[hit]])
    return nearest.reshape(rows, height, width), depth.reshape(rows, height, width)


def _cross(a: Tensor, b: Tensor) -> Tensor:
    """Cross product of 2-D vectors."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _chunks(counts: Tensor) -> list[tuple[slice, int]]:
    """Consecutive ranges of triangles with about ``CHUNK`` pixel centres each, and how many these are."""
    if not len(counts):
        return []
    total = counts.cumsum(0)
    samples = int(total[-1])
    if samples <= CHUNK:
        return [(slice(0, len(counts)), samples)]
    group = torch.div(total - counts, CHUNK, rounding_mode="floor")
    sizes = torch.unique_consecutive(group, return_counts=True)[1].cumsum(0)
    stops, ends = sizes.tolist(), total[sizes - 1].tolist()
    starts, before = [0, *stops[:-1]], [0, *ends[:-1]]
    return [(slice(*bounds), end - start) for *bounds, start, end in zip(starts, stops, before, ends, strict=True)]


def _test_centres(corners: Tensor, area: Tensor, centre: Tensor) -> tuple[Tensor, Tensor]:
    """NDC depth of triangles (sample, 3, 3) at pixel centres (sample, 2), and whether they are inside or on an edge."""
    a, b, c = corners.unbind(1)
    sign = torch.where(area > 0, 1.0, -1.0).to(area)
    e0 = sign * _cross(c[:, :2] - b[:, :2], centre - b[:, :2])
    e1 = sign * _cross(a[:, :2] - c[:, :2], centre - c[:, :2])
    e2 = sign * _cross(b[:, :2] - a[:, :2], centre - a[:, :2])
    z = (e0 * a[:, 2] + e1 * b[:, 2] + e2 * c[:, 2]) / (sign * area)
    return z, (e0 >= 0) & (e1 >= 0) & (e2 >= 0)


def _keep_nearest(depth: Tensor, nearest: Tensor, pixel: Tensor, z: Tensor, face: Tensor) -> None:
    """Depth-test samples in place; the lowest face index wins a tie."""
    updated = depth.scatter_reduce(0, pixel, z, "amin")
    last = torch.iinfo(torch.long).max
    nearest.masked_fill_((updated < depth) | (nearest < 0), last)
    depth.copy_(updated)
    nearest.scatter_reduce_(0, pixel, face.masked_fill(z != depth[pixel], last), "amin")
    nearest.masked_fill_(nearest == last, -1)


def barycentrics(
    clip_verts: Float[Tensor, "row vert 4"], faces: Int[Tensor, "face 3"], face_index: Int[Tensor, "row height width"]
) -> Float[Tensor, "row height width 3"]:
    """Perspective-correct barycentrics at the pixel centres, 0 on background.

    With P_k = (X_k - x W_k, Y_k - y W_k) of the corners of a face at NDC (x, y), the weight of corner k is
    proportional to the cross product of the two other P (homogeneous 2-D rasterisation, no division by w).
    """
    rows, height, width = face_index.shape
    pixels = (face_index >= 0).reshape(-1).nonzero().squeeze(1)
    row, i, j = pixels // (height * width), pixels // width % height, pixels % width
    corners = faces[face_index.reshape(-1)[pixels]] + (row * clip_verts.shape[1])[:, None]
    clip = clip_verts.reshape(-1, 4).index_select(0, corners.reshape(-1)).reshape(-1, 3, 4).double()
    centre = torch.stack(((2 * j + 1).double() / width - 1, (2 * i + 1).double() / height - 1), dim=1)
    point = clip[..., :2] - centre[:, None] * clip[..., 3:]  # (pixel, 3, 2)
    edge = _cross(point[:, [1, 2, 0]], point[:, [2, 0, 1]])
    total = edge.sum(dim=1, keepdim=True)
    degenerate = total == 0
    weights = torch.where(degenerate, 1 / 3, edge / torch.where(degenerate, 1, total)).to(clip_verts.dtype)
    dense = weights.new_zeros(rows * height * width, 3).index_copy(0, pixels, weights)
    return dense.reshape(rows, height, width, 3)
