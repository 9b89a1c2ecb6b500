"""Implicit body-centred cubic (BCC) lattice, mirror symmetric about x = 0, of which only x >= 0 is ever stored.

Cubic cells of edge ``cell_size`` have a lattice point at each corner and at the centre. Every face between two cells
gives four tetrahedra: the two centres and one edge of the face, so there are twelve of one single shape per cell. The
plane x = 0 is a layer of corners; the tetrahedra of its faces straddle it and are their own mirror images.

A lattice point is named by an integer, corners first, then centres, both raster ordered with x slowest. 104 cells over
the paper's 7 units have about as many points as its "256" grid, and so do 13 * 2**k cells for a "32 * 2**k" grid.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

CELLS_PER_RESOLUTION = 13 / 32
"""BCC cells along an edge per unit of the paper's grid resolution; gives about the same number of points."""

BORDER_DEPTH = 0.25
"""Cells by which border points are outside at least; any positive value closes the mesh."""


def cell_size_of(grid_scale: float, grid_resolution: int) -> float:
    """Cell edge, world units, of the BCC lattice equivalent to the paper's grid.

    Args:
        grid_scale: edge length of the paper's cube, world units.
        grid_resolution: the paper's resolution, e.g. 128 or 256.
    """
    return grid_scale / (CELLS_PER_RESOLUTION * grid_resolution)


@dataclass(frozen=True)
class BCCLattice:
    """The half ``x >= 0`` of a symmetric BCC lattice centred on the origin.

    Attributes:
        cell_size: edge of a cubic cell, world units.
        half_extents: half edge lengths of the box along x, y, z, world units; rounded to whole cells.
    """

    cell_size: float
    half_extents: tuple[float, float, float]

    @cached_property
    def shape(self) -> tuple[int, int, int]:
        """Cells along x (of the half), y and z."""
        x, y, z = self.half_extents
        nx, ny, nz = (max(1, round(length / self.cell_size)) for length in (x, 2 * y, 2 * z))
        return nx, ny, nz

    @cached_property
    def box(self) -> tuple[float, float, float]:
        """Half edge lengths of the box after rounding, world units."""
        nx, ny, nz = self.shape
        return nx * self.cell_size, ny * self.cell_size / 2, nz * self.cell_size / 2

    @property
    def num_cells(self) -> int:
        """Cells, equally centres, of the half."""
        nx, ny, nz = self.shape
        return nx * ny * nz

    @property
    def num_corners(self) -> int:
        """Corners of the half, those on the mirror plane included."""
        nx, ny, nz = self.shape
        return (nx + 1) * (ny + 1) * (nz + 1)

    def cell_index(self, cells: Int[Tensor, " cell"]) -> Int[Tensor, "cell 3"]:
        """Position (i, j, k) of cells given by number."""
        return _unravel(cells, self.shape)

    def cell_number(self, index: Int[Tensor, "*cell 3"]) -> Int[Tensor, "*cell"]:
        """Inverse of :meth:`cell_index`."""
        _, ny, nz = self.shape
        return (index[..., 0] * ny + index[..., 1]) * nz + index[..., 2]

    def corner_number(self, index: Int[Tensor, "*corner 3"]) -> Int[Tensor, "*corner"]:
        """Number of the corner at grid position (i, j, k), 0 <= i <= nx and so on."""
        _, ny, nz = self.shape
        return (index[..., 0] * (ny + 1) + index[..., 1]) * (nz + 1) + index[..., 2]

    def centre_number(self, index: Int[Tensor, "*cell 3"]) -> Int[Tensor, "*cell"]:
        """Number of the lattice point in the middle of the cells (i, j, k)."""
        return self.cell_number(index) + self.num_corners

    def contains(self, index: Int[Tensor, "*cell 3"]) -> Bool[Tensor, "*cell"]:
        """Whether cell positions lie in the half box."""
        limits = torch.tensor(self.shape, device=index.device)
        return ((index >= 0) & (index < limits)).all(dim=-1)

    def half_steps(self, points: Int[Tensor, " point"]) -> Int[Tensor, "point 3"]:
        """Coordinates in half cells counted from the box's low corner on the mirror plane: corners even, centres odd."""
        nx, ny, nz = self.shape
        is_corner = (points < self.num_corners)[:, None]
        corner = 2 * _unravel(points.clamp(max=self.num_corners - 1), (nx + 1, ny + 1, nz + 1))
        centre = 2 * _unravel((points - self.num_corners).clamp(min=0), self.shape) + 1
        return torch.where(is_corner, corner, centre)

    def number(self, half_steps: Int[Tensor, "point 3"]) -> Int[Tensor, " point"]:
        """Inverse of :meth:`half_steps`."""
        index = half_steps // 2
        return torch.where(half_steps[:, 0] % 2 == 0, self.corner_number(index), self.centre_number(index))

    def positions(self, points: Int[Tensor, " point"], offset: Float[Tensor, "3"]) -> Float[Tensor, "point 3"]:
        """World coordinates of lattice points in the dtype of ``offset``, which shifts the lattice."""
        return self.embed(self.half_steps(points), offset)

    def embed(self, half_steps: Int[Tensor, "point 3"], offset: Float[Tensor, "3"]) -> Float[Tensor, "point 3"]:
        """World coordinates of positions given in half cells; see :meth:`half_steps`."""
        _, ny, nz = self.shape
        origin = torch.tensor((0, ny, nz), device=half_steps.device)
        return (half_steps - origin).to(offset.dtype) * (self.cell_size / 2) + offset

    def border(self, half_steps: Int[Tensor, "point 3"]) -> Bool[Tensor, " point"]:
        """Whether points bound the union of tetrahedra: corners on the box and centres of the cells along it."""
        nx, ny, nz = self.shape
        high = torch.tensor((2 * nx - 1, 2 * ny - 1, 2 * nz - 1), device=half_steps.device)
        return (half_steps >= high).any(dim=1) | (half_steps[:, 1:] <= 1).any(dim=1)

    def close(self, half_steps: Int[Tensor, "point 3"], sdf: Float[Tensor, " point"]) -> Float[Tensor, " point"]:
        """Signed distances made negative on the border, so that a surface leaving the box is closed there."""
        closed = sdf.clamp(max=-BORDER_DEPTH * self.cell_size)
        return torch.where(self.border(half_steps), closed, sdf)


@dataclass(frozen=True)
class ExplicitLattice:
    """Both halves of a lattice, every tetrahedron written out; for references and small lattices.

    Points beyond ``half_points.numel()`` of the half lattice are the mirror images.

    Attributes:
        points: (vert,) number in the half lattice of each point or of its mirror image.
        mirrored: (vert,) whether the point lies at x < 0.
        tets: (tet, 4) indices into ``points``; mirrored tetrahedra keep the order of their originals.
    """

    points: Int[Tensor, " vert"]
    mirrored: Bool[Tensor, " vert"]
    tets: Int[Tensor, "tet 4"]

    def positions(self, lattice: BCCLattice, offset: Float[Tensor, "3"]) -> Float[Tensor, "vert 3"]:
        """World coordinates of all points."""
        return mirror_x(lattice.positions(self.points, offset), self.mirrored)


def mirror_x(verts: Float[Tensor, "vert 3"], mirrored: Bool[Tensor, " vert"]) -> Float[Tensor, "vert 3"]:
    """Negate x where ``mirrored``."""
    sign = torch.where(mirrored, -1.0, 1.0).to(verts)
    return torch.cat((verts[:, :1] * sign[:, None], verts[:, 1:]), dim=1)


def face_ring(axis: int) -> Int[Tensor, "4 3"]:
    """Corner offsets (0 or 1, along ``axis`` 0) of a face with normal +axis, counter-clockwise seen from +axis."""
    ring = torch.zeros(4, 3, dtype=torch.long)
    ring[:, (axis + 1) % 3] = torch.tensor((0, 1, 1, 0))
    ring[:, (axis + 2) % 3] = torch.tensor((0, 0, 1, 1))
    return ring


def explicit_lattice(lattice: BCCLattice) -> ExplicitLattice:
    """List every point and positively oriented tetrahedron of a lattice, mirror images included."""
    half = lattice.num_corners + lattice.num_cells
    points = torch.arange(half)
    off_plane = points[lattice.half_steps(points)[:, 0] > 0]
    image = points.clone()
    image[off_plane] = half + torch.arange(len(off_plane))

    index = lattice.cell_index(torch.arange(lattice.num_cells))
    one_sided = []
    for axis in range(3):
        step = torch.eye(3, dtype=torch.long)[axis]
        low = index[index[:, axis] + 1 < lattice.shape[axis]]
        one_sided.append(face_tets(lattice, low, low + step, face_ring(axis) + step))
    straddling = face_tets(lattice, index[index[:, 0] == 0], index[index[:, 0] == 0], face_ring(0))
    straddling[:, 0] = image[straddling[:, 0]]
    tets = torch.cat(one_sided)
    return ExplicitLattice(
        points=torch.cat((points, off_plane)),
        mirrored=torch.arange(half + len(off_plane)) >= half,
        tets=torch.cat((tets, straddling, image[tets])),
    )


@runtime_checkable
class Numbering(Protocol):
    """Names lattice points by integers: a :class:`BCCLattice` all of them, ``Bricks`` those near a surface."""

    def corner_number(self, index: Tensor) -> Tensor:
        """Number of the corners at grid positions (i, j, k)."""
        ...

    def centre_number(self, index: Tensor) -> Tensor:
        """Number of the centres of cells (i, j, k)."""
        ...


def face_tets(
    numbering: Numbering, low: Int[Tensor, "face 3"], high: Int[Tensor, "face 3"], ring: Int[Tensor, "4 3"]
) -> Int[Tensor, "tet 4"]:
    """Tetrahedra (low centre, high centre, ring t, ring t + 1) of the faces between two lists of cells."""
    corners = numbering.corner_number(low[:, None] + ring)  # (face, 4)
    centres = torch.stack((numbering.centre_number(low), numbering.centre_number(high)), dim=1)
    edges = torch.stack((corners, corners.roll(-1, dims=1)), dim=2)  # (face, 4, 2)
    return torch.cat((centres[:, None].expand(-1, 4, -1), edges), dim=2).flatten(0, 1)


def _unravel(numbers: Tensor, shape: tuple[int, int, int]) -> Tensor:
    _, ny, nz = shape
    plane, k = numbers // nz, numbers % nz
    return torch.stack((plane // ny, plane % ny, k), dim=-1)
