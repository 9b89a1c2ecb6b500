"""Where a mesh lies in a picture: charts by xatlas, and which point of the surface each texel shows."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int, Shaped
from scipy import ndimage, sparse
from torch import Tensor

from fauna.errors import FaunaError
from fauna.renderer.base import Renderer
from fauna.types import Fragments, Topology

_SMOOTHING = 3
"""Rounds of averaging before charts are cut: extracted meshes are faceted, and every facet would tempt the cutter."""
_PADDING = 4
"""Texels between charts."""
SMALLEST, LARGEST = 64, 8192
"""Sides of an image that make sense, texels."""


@dataclass(frozen=True, eq=False)
class Atlas:
    """UV coordinates of a mesh.

    Attributes:
        vertex: mesh vertex of each UV vertex.
        faces: UV vertices of each face, in the order of the mesh's faces.
        uv: in [0, 1], origin top left.
    """

    vertex: Int[Tensor, " uv_vert"]
    faces: Int[Tensor, "face 3"]
    uv: Float[Tensor, "uv_vert 2"]


@dataclass(frozen=True, eq=False)
class Texels:
    """The texels of a square image that show the surface.

    Attributes:
        size: side of the image, texels.
        index: flat indices (row-major, row 0 at the top), ascending.
        face: mesh face each shows.
        corners: (texel, 3) mesh vertices of that face.
        barycentrics: (texel, 3) place in the face.
    """

    size: int
    index: Int[Tensor, " texel"]
    face: Int[Tensor, " texel"]
    corners: Int[Tensor, "texel 3"]
    barycentrics: Float[Tensor, "texel 3"]

    def interpolate(self, values: Float[Tensor, "vert chan"]) -> Float[Tensor, "texel chan"]:
        """Values of mesh vertices at the texels."""
        return torch.einsum("tk,tkc->tc", self.barycentrics.to(values.dtype), values[self.corners])


def unwrap(verts: Float[Tensor, "vert 3"], faces: Int[Tensor, "face 3"], topology: Topology, *, size: int) -> Atlas:
    """Cut a mesh into charts and pack them.

    Charts are cut on a slightly smoothed copy of the mesh: 20 to 40 charts instead of some 300 on marching
    tetrahedra, hence fewer seams.

    Args:
        verts: rest positions, world units.
        faces: of the mesh.
        topology: its edges.
        size: of the image the atlas is meant for, texels; the padding depends on it.

    Raises:
        FaunaError: for an image size that makes no sense, or a mesh without faces.
    """
    if not SMALLEST <= size <= LARGEST:
        raise FaunaError(f"texture: expected a size from {SMALLEST} to {LARGEST} texels, got {size}; use 1024")
    if not len(faces):
        raise FaunaError("texture: expected a mesh with faces, got none; the reconstruction is empty")
    import xatlas  # compiled; only needed here

    smooth = _smoothed(verts.detach().cpu().double().numpy(), topology.edges.cpu().numpy())
    charts, packing, atlas = xatlas.ChartOptions(), xatlas.PackOptions(), xatlas.Atlas()
    packing.resolution, packing.padding = size, _PADDING
    atlas.add_mesh(smooth.astype(np.float32), faces.cpu().numpy().astype(np.uint32))
    atlas.generate(charts, packing)
    vertex, uv_faces, uv = atlas[0]
    return Atlas(
        *(torch.from_numpy(each).to(verts.device) for each in (vertex.astype(np.int64), uv_faces.astype(np.int64), uv))
    )


def texels_of(renderer: Renderer, atlas: Atlas, size: int) -> Texels:
    """Which point of the surface each texel's centre shows.

    Args:
        renderer: draws the charts.
        atlas: of the mesh.
        size: side of the image, texels.
    """
    flat = torch.cat((2.0 * atlas.uv - 1.0, torch.zeros_like(atlas.uv[:, :1]), torch.ones_like(atlas.uv[:, :1])), dim=1)
    fragments: Fragments = renderer.rasterize(flat[None], atlas.faces, size, size)
    index = fragments.covered.reshape(-1).nonzero()[:, 0]
    face = fragments.face_index.reshape(-1)[index]
    corners = atlas.vertex[atlas.faces][face]
    return Texels(size, index, face, corners, fragments.barycentrics.reshape(-1, 3)[index])


def fill(
    image: Shaped[np.ndarray, "size size chan"], known: Bool[np.ndarray, "size size"]
) -> Shaped[np.ndarray, "size size chan"]:
    """Give texels that show nothing the colour of the nearest one that does, so that filtering never meets black."""
    if not known.any():
        return image
    nearest: np.ndarray = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)  # pyright: ignore[reportAssignmentType]
    return image[nearest[0], nearest[1]]


def _smoothed(verts: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Each vertex moved half-way to the mean of its neighbours, :data:`_SMOOTHING` times."""
    ends = np.concatenate((edges, edges[:, ::-1]))
    adjacency = sparse.csr_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(verts), len(verts)))
    degree = np.maximum(adjacency.sum(axis=1), 1.0)[:, None]
    lonely = (adjacency.sum(axis=1) == 0)[:, None]
    for _ in range(_SMOOTHING):
        verts = np.where(lonely, verts, 0.5 * (verts + adjacency @ verts / degree))
    return verts
