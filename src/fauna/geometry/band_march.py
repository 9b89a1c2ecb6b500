"""Marching tetrahedra around the active cells of a narrow band. On CPU in numba kernels when numba is installed."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Int
from torch import Tensor

from fauna.geometry.band_ops import RINGS, half_steps, in_kernels, kernels
from fauna.geometry.lattice import face_tets
from fauna.geometry.marching_tets import TET_EDGES, case_table, crossing_edges, tet_triangles
from fauna.geometry.narrow_band import NarrowBand


@dataclass(frozen=True)
class HalfSurface:
    """Triangles of the half x >= 0 and across its plane.

    Attributes:
        ends: (vert, 2) points at the inner and the outer end of each vertex's edge, in the numbers of the bricks;
            ordered by the lower and the higher number in the lattice, so that bricks leave no trace in the mesh.
        faces: (face, 3) triangles at x >= 0.
        straddling: (crossing, 3) triangles across the plane, ``vert + i`` for the mirror image of vertex ``i``.
    """

    ends: Int[Tensor, "vert 2"]
    faces: Int[Tensor, "face 3"]
    straddling: Int[Tensor, "crossing 3"]


def march(band: NarrowBand) -> HalfSurface | None:
    """Triangles of the tetrahedra that touch active cells; ``None`` when there are none."""
    cells = band.cells()
    surface = _march_numba(band, cells) if in_kernels(cells) else _march_torch(band, cells)
    return _ordered(surface, band) if len(surface.ends) else None


def _ordered(surface: HalfSurface, band: NarrowBand) -> HalfSurface:
    """Vertices in the order of the lattice."""
    lattice, count = band.lattice, len(surface.ends)
    numbers = lattice.number(half_steps(surface.ends.flatten(), band.bricks)).view(-1, 2)
    keys = numbers.amin(dim=1) * (lattice.num_corners + lattice.num_cells) + numbers.amax(dim=1)
    order = keys.argsort()
    rank = torch.empty_like(order)
    rank[order] = torch.arange(count, device=order.device)
    both = torch.cat((rank, rank + count))
    return HalfSurface(surface.ends[order], rank[surface.faces], both[surface.straddling])


def _march_numba(band: NarrowBand, cells: Tensor) -> HalfSurface:
    assert kernels is not None
    bricks = band.bricks
    marks = band.inside.numpy(), band.active.numpy(), bricks.table.numpy()
    tables = case_table().numpy(), np.array(TET_EDGES)
    inner, outer, split = kernels.crossed_edges(cells.numpy(), *marks, bricks.grid, RINGS.numpy(), *tables)
    ends, vertex = (torch.from_numpy(array) for array in kernels.number_edges(inner, outer, len(bricks)))
    return HalfSurface(ends, vertex[:split].view(-1, 3), vertex[split:].view(-1, 3))


def _march_torch(band: NarrowBand, cells: Tensor) -> HalfSurface:
    num_points = len(band.bricks)
    one_sided, straddling = _mixed_tets(band, cells)
    inside = band.inside[one_sided]
    faces, _ = tet_triangles(inside, crossing_edges(inside, one_sided, num_points))
    inside = band.inside[straddling]
    keys = crossing_edges(inside, straddling, num_points)
    keys[:, 1:3] += num_points**2  # edges from the mirror image of a centre to the two corners on the plane
    crossing, _ = tet_triangles(inside, keys)

    places = torch.cat((faces, crossing))
    keys, vertex = torch.unique(places % num_points**2, return_inverse=True)
    vertex = vertex + len(keys) * (places // num_points**2)
    ends = torch.stack((keys // num_points, keys % num_points), dim=1)
    return HalfSurface(ends, vertex[: len(faces)], vertex[len(faces) :])


def _mixed_tets(band: NarrowBand, cells: Tensor) -> tuple[Tensor, Tensor]:
    """(tet, 4) points of crossed tetrahedra touching active cells: those at x >= 0, those across the plane.

    The latter start with the centre at x > 0 standing for its mirror image, then the centre itself.
    """
    bricks = band.bricks
    one_sided = []
    for axis in range(3):
        step = torch.eye(3, dtype=torch.long, device=cells.device)[axis]
        below = cells - step
        below = below[(below[:, axis] >= 0)]
        below = below[~band.active[bricks.centre_number(below)]]
        low = torch.cat((cells[cells[:, axis] + 1 < band.lattice.shape[axis]], below))
        one_sided.append(face_tets(bricks, low, low + step, RINGS[axis].to(cells.device) + step))
    at_plane = cells[cells[:, 0] == 0]
    straddling = face_tets(bricks, at_plane, at_plane, RINGS[0].to(cells.device))
    return _mixed(band, torch.cat(one_sided)), _mixed(band, straddling)


def _mixed(band: NarrowBand, tets: Tensor) -> Tensor:
    inside = band.inside[tets]
    return tets[inside.any(1) & ~inside.all(1)]
