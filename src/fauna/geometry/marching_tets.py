"""Marching tetrahedra on any tetrahedral mesh, and clean-up of what it returns.

A point is inside where its signed distance is > 0. An edge with one end inside carries a vertex where the linear
interpolant vanishes; a tetrahedron with mixed corners carries one or two triangles, counter-clockwise from outside.
"""

from functools import cache
from itertools import product

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from torch import Tensor

TET_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
"""Corners of the six edges of a tetrahedron, in the order used by :func:`tet_triangles`."""

_REFERENCE = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=float)


def tet_triangles(
    inside: Bool[Tensor, "tet 4"], edges: Int[Tensor, "tet 6"]
) -> tuple[Int[Tensor, "face 3"], Int[Tensor, " face"]]:
    """Triangles of positively oriented tetrahedra, as the numbers of the edges their corners lie on.

    Args:
        inside: whether each corner is inside.
        edges: a number for each edge, in the order of ``TET_EDGES``.

    Returns:
        Triangles, counter-clockwise seen from outside, and the tetrahedron each one lies in. The first triangles of all
        tetrahedra come before the second ones.
    """
    table = case_table().to(inside.device)
    case = (inside * torch.tensor((1, 2, 4, 8), device=inside.device)).sum(dim=1)
    local = table[case]  # (tet, 2, 3)
    faces, tets = [], []
    for triangle in range(2):
        tet = (local[:, triangle, 0] >= 0).nonzero()[:, 0]
        faces.append(edges[tet].gather(1, local[tet, triangle]))
        tets.append(tet)
    return torch.cat(faces), torch.cat(tets)


def crossing_edges(inside: Bool[Tensor, "tet 4"], tets: Int[Tensor, "tet 4"], num_points: int) -> Int[Tensor, "tet 6"]:
    """One number per edge, ``num_points * inner end + outer end``, in the order of ``TET_EDGES``.

    Edges with both ends on one side get a number without meaning.
    """
    first, second = ([ends[side] for ends in TET_EDGES] for side in (0, 1))
    straight = tets[:, first] * num_points + tets[:, second]
    return torch.where(inside[:, first], straight, tets[:, second] * num_points + tets[:, first])


def interpolate_zeros(ends: Float[Tensor, "vert 2 3"], sdf: Float[Tensor, "vert 2"]) -> Float[Tensor, "vert 3"]:
    """Points between edge ends, the inner one first, where the linear interpolant of the signed distance vanishes.

    Values that contradict their side by round-off count as zero there, so that the result never leaves the edge.
    """
    inner = sdf[:, :1].clamp(min=torch.finfo(sdf.dtype).tiny)
    outer = sdf[:, 1:].clamp(max=0.0)
    return ends[:, 0] + inner / (inner - outer) * (ends[:, 1] - ends[:, 0])


def marching_tets(
    verts: Float[Tensor, "point 3"], sdf: Float[Tensor, " point"], tets: Int[Tensor, "tet 4"]
) -> tuple[Float[Tensor, "vert 3"], Int[Tensor, "face 3"]]:
    """Zero level of a signed distance given at the corners of tetrahedra.

    Vertices are ordered by (inner, outer) end point of their edge. Nothing as large as the mesh is sorted, only the
    edges of tetrahedra that the surface crosses. A mesh of (0, 3) arrays comes back when the surface is empty.

    Args:
        verts: corner positions, world units.
        sdf: signed distances, > 0 inside.
        tets: corners of each tetrahedron, either orientation.
    """
    occupied = sdf > 0
    count = occupied[tets].sum(dim=1)
    tets = tets[(count > 0) & (count < 4)]
    inside = occupied[tets]
    faces, tet = tet_triangles(inside, crossing_edges(inside, tets, len(verts)))

    corners = verts.detach()[tets]
    negative = torch.linalg.det(corners[:, 1:] - corners[:, :1]) < 0
    faces = torch.where(negative[tet][:, None], faces.flip(1), faces)

    keys, faces = torch.unique(faces, return_inverse=True)
    ends = torch.stack((keys // len(verts), keys % len(verts)), dim=1)
    return interpolate_zeros(verts[ends], sdf[ends]), faces


def face_components(faces: Int[Tensor, "face 3"], num_verts: int) -> Int[Tensor, " face"]:
    """Connected component of each face, numbered from 0; faces are connected through shared vertices."""
    array = faces.cpu().numpy()
    rows = np.concatenate((array[:, 0], array[:, 0]))
    columns = np.concatenate((array[:, 1], array[:, 2]))
    graph = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(num_verts, num_verts))
    _, labels = connected_components(graph, directed=False)
    _, labels = np.unique(labels[array[:, 0]], return_inverse=True)
    return torch.from_numpy(labels.astype(np.int64)).to(faces.device)


def drop_small_components(
    verts: Float[Tensor, "vert 3"], faces: Int[Tensor, "face 3"], min_fraction: float
) -> tuple[Float[Tensor, "kept_vert 3"], Int[Tensor, "kept_face 3"]]:
    """Remove components that hold fewer than ``min_fraction`` of the faces; the largest always stays.

    Order is kept, vertices without a face go. Mirror images are equally large and so share their fate.
    """
    if min_fraction <= 0 or len(faces) == 0:
        return verts, faces
    component = face_components(faces, len(verts))
    size = torch.bincount(component)
    keep = (size >= min_fraction * len(faces)) | (size == size.max())
    if bool(keep.all()):
        return verts, faces
    faces = faces[keep[component]]
    used = torch.zeros(len(verts), dtype=torch.bool, device=verts.device)
    used[faces.flatten()] = True
    return verts[used], (used.cumsum(0) - 1)[faces]


@cache
def case_table() -> Tensor:
    """(16, 2, 3) edges of the triangles for each inside pattern (bit i: corner i inside), -1 where there is none."""
    table = torch.full((16, 2, 3), -1)
    for bits in product((False, True), repeat=4):
        inner = [i for i in range(4) if bits[i]]
        outer = [i for i in range(4) if not bits[i]]
        case = sum(1 << i for i in inner)
        if len(inner) in (1, 3):
            triangles = [[(i, o) for i in inner for o in outer]]
        elif len(inner) == 2:
            (a, b), (c, d) = inner, outer
            triangles = [[(a, c), (b, c), (b, d)], [(a, c), (b, d), (a, d)]]
        else:
            triangles = []
        for row, triangle in enumerate(triangles):
            corners = np.array([_REFERENCE[[i, o]].mean(axis=0) for i, o in triangle])
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            outwards = _REFERENCE[outer].mean(axis=0) - _REFERENCE[inner].mean(axis=0)
            ordered = triangle if normal @ outwards > 0 else triangle[::-1]
            table[case, row] = torch.tensor([TET_EDGES.index((min(edge), max(edge))) for edge in ordered])
    return table
