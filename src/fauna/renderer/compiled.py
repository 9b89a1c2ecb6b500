"""The compiled CPU rasteriser. Importing this module needs numba; ``NumbaRenderer`` decides when to use it."""

import numba
from jaxtyping import Float, Int
from torch import Tensor

from fauna.renderer.base import Renderer
from fauna.renderer.checks import check_attributes, check_mesh, check_pixels, check_topology
from fauna.renderer.contour import Contour
from fauna.renderer.numba_functions import Antialias, Interpolate, InterpolateAt, Rasterize, Silhouette, Transfers
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
        arguments = (faces.long(), height, width, _bands(clip_verts))
        face_index, depth, barycentrics = Rasterize.apply(clip_verts, *arguments)
        return Fragments(face_index, barycentrics, depth)

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
        check_topology(topology, clip_verts, faces)
        mesh = (clip_verts, faces.long(), topology.edges.long(), topology.edge_faces.long())
        return Antialias.apply(image, *mesh, fragments.face_index, fragments.depth)

    def contour(
        self,
        fragments: Fragments,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        topology: Topology,
    ) -> Contour:
        """See :meth:`Renderer.contour`."""
        check_topology(topology, clip_verts, faces)
        mesh = (clip_verts, faces.long(), topology.edges.long(), topology.edge_faces.long())
        return Contour(*Transfers.apply(*mesh, fragments.face_index, fragments.depth))

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
        mesh = (clip_verts, faces.long(), topology.edges.long(), topology.edge_faces.long())
        return Silhouette.apply(*mesh, height, width, _bands(clip_verts))


def _bands(clip_verts: Tensor) -> int:
    """Bands of pixel rows per image, so that every thread has work."""
    rows, threads = clip_verts.shape[0], numba.get_num_threads()
    return 1 if rows >= threads else -(-threads // max(rows, 1))
