"""The compiled CPU rasteriser. Importing this module needs numba; ``NumbaRenderer`` decides when to use it."""

import numba
import torch
from jaxtyping import Float, Int
from torch import Tensor

from fauna.kernels import raster, silhouette
from fauna.renderer.base import Renderer, check_attributes, check_mesh, check_topology
from fauna.renderer.contour import Contour, make_contour
from fauna.renderer.edges import DEPTH_TOLERANCE, Crossings, blend_weights
from fauna.renderer.numba_functions import Barycentrics, Blend, Interpolate, InterpolateAt, as_numpy
from fauna.types import Fragments, Topology


class CompiledRenderer(Renderer):
    """Rasteriser in numba kernels for CPU tensors, with the rules and results of the torch backend.

    Gradients are accumulated per image by a single thread: bitwise equal on every run and for every thread count.
    """

    def rasterize(
        self, clip_verts: Float[Tensor, "row vert 4"], faces: Int[Tensor, "face 3"], height: int, width: int
    ) -> Fragments:
        """See :meth:`Renderer.rasterize`."""
        check_mesh(clip_verts, faces, height, width)
        screen = raster.project(as_numpy(clip_verts), height, width, True)
        ids, depth = raster.rasterize(screen, as_numpy(faces.long()), height, width, _bands(len(screen)))
        face_index = torch.from_numpy(ids)
        barycentrics = Barycentrics.apply(clip_verts, faces.long(), face_index)
        return Fragments(face_index, barycentrics, torch.from_numpy(depth).to(clip_verts.dtype))

    def interpolate(
        self,
        fragments: Fragments,
        faces: Int[Tensor, "face 3"],
        attributes: Float[Tensor, "row_or_1 vert chan"],
    ) -> Float[Tensor, "row chan height width"]:
        """See :meth:`Renderer.interpolate`."""
        attributes = check_attributes(fragments, faces, attributes)
        return Interpolate.apply(attributes, fragments.barycentrics, faces.long(), fragments.face_index)

    def interpolate_at(
        self,
        fragments: Fragments,
        faces: Int[Tensor, "face 3"],
        attributes: Float[Tensor, "row_or_1 vert chan"],
        pixels: Int[Tensor, " pixel"],
    ) -> Float[Tensor, "pixel chan"]:
        """See :meth:`Renderer.interpolate_at`."""
        attributes = check_attributes(fragments, faces, attributes)
        check_pixels(fragments, pixels)
        arguments = (fragments.barycentrics, faces.long(), fragments.face_index, pixels.long())
        return InterpolateAt.apply(attributes, *arguments)

    def antialias(
        self,
        image: Float[Tensor, "row chan height width"],
        fragments: Fragments,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        topology: Topology,
    ) -> Float[Tensor, "row chan height width"]:
        """See :meth:`Renderer.antialias`."""
        return self._blend(image, fragments.face_index, fragments.depth, clip_verts, faces, topology)

    def contour(
        self,
        fragments: Fragments,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        topology: Topology,
    ) -> Contour:
        """See :meth:`Renderer.contour`."""
        _, height, width = fragments.face_index.shape
        crossings = self._find_crossings(clip_verts, faces, topology, fragments.face_index, fragments.depth)
        weights = blend_weights(crossings, clip_verts, topology, height, width, self.soft_edges)
        return make_contour(crossings, weights, height, width)

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
        screen = raster.project(as_numpy(clip_verts), height, width, True)
        ids = torch.from_numpy(raster.cover(screen, as_numpy(faces.long()), height, width, _bands(len(screen))))
        coverage = (ids >= 0)[:, None].to(clip_verts.dtype)
        return self._blend(coverage, ids, None, clip_verts, faces, topology).squeeze(1).clamp(0, 1)

    def _blend(
        self, image: Tensor, ids: Tensor, depth: Tensor | None, clip_verts: Tensor, faces: Tensor, topology: Topology
    ) -> Tensor:
        """Antialias ``image``; ids >= 0 where covered; without depth only pairs with background are blended."""
        height, width = image.shape[-2:]
        crossings = self._find_crossings(clip_verts, faces, topology, ids, depth)
        weights = blend_weights(crossings, clip_verts, topology, height, width, self.soft_edges)
        return Blend.apply(image, weights, *crossings.pixels(height, width))

    def _find_crossings(
        self, clip_verts: Tensor, faces: Tensor, topology: Topology, ids: Tensor, depth: Tensor | None
    ) -> Crossings:
        check_topology(topology, clip_verts, faces)
        _, height, width = ids.shape
        screen = raster.project(as_numpy(clip_verts), height, width, False)
        edges, offsets = silhouette.find_crossings(
            screen,
            as_numpy(faces.long()),
            as_numpy(topology.edges),
            as_numpy(topology.edge_faces),
            as_numpy(ids),
            as_numpy(clip_verts.new_zeros(1, 1, 1) if depth is None else depth),
            depth is not None,
            DEPTH_TOLERANCE,
            self.soft_edges,
        )
        edge = torch.from_numpy(edges).view(-1)
        cell = (edge >= 0).nonzero().squeeze(1)
        return Crossings(cell, edge[cell].long(), torch.from_numpy(offsets).view(-1)[cell])


def check_pixels(fragments: Fragments, pixels: Tensor) -> None:
    """Reject pixel indices outside the images."""
    count = fragments.face_index.numel()
    if pixels.numel():
        low, high = (int(bound) for bound in torch.aminmax(pixels))
        if low < 0 or high >= count:
            raise IndexError(f"pixels must lie in 0..{count - 1}, got {low}..{high}")


def _bands(rows: int) -> int:
    """Bands of pixel rows per image, so that every thread has work."""
    threads = numba.get_num_threads()
    return 1 if rows >= threads else -(-threads // max(rows, 1))
