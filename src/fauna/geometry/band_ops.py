"""Integer steps of the narrow band as pure functions: in torch on any device, on CPU in numba kernels when installed.

Marks returned by :func:`surroundings` and :func:`behind` are indexed by the numbers of the bricks.
"""

from itertools import product

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fauna.geometry.bricks import EDGE, Bricks
from fauna.geometry.lattice import BCCLattice, face_ring

try:
    from fauna.kernels import narrow_band as kernels
except ImportError:
    kernels = None

_CORNERS = torch.tensor(list(product((0, 1), repeat=3)))
_NEIGHBOURS = torch.cat((torch.zeros(1, 3, dtype=torch.long), torch.eye(3, dtype=torch.long), -torch.eye(3).long()))
RINGS = torch.stack([face_ring(axis) for axis in range(3)])
"""(axis, 4, 3) corner offsets of the low face of a cell along each axis."""


def in_kernels(tensor: Tensor) -> bool:
    """Whether the kernels can be used for ``tensor``."""
    return kernels is not None and tensor.device.type == "cpu"


def kept_blocks(
    blocks: Int[Tensor, "block 3"],
    values: Float[Tensor, " block"],
    size: int,
    reach: float,
    margin: Float[Tensor, ""],
    lattice: BCCLattice,
) -> Int[Tensor, "kept 3"]:
    """Blocks of ``size`` cells that may hold a sign change.

    Args:
        blocks: position in units of ``size`` cells.
        values: signed distance at their centres, off by at most ``margin``.
        size: cells along an edge.
        reach: largest change of the signed distance inside a block, world units.
        margin: world units.
        lattice: at its border, outside by decree, a block with its centre inside is kept too.
    """
    if in_kernels(blocks):
        assert kernels is not None
        arrays = blocks.numpy(), values.numpy()
        return torch.from_numpy(kernels.survivors(*arrays, size, reach, float(margin), np.array(lattice.shape)))
    shape = torch.tensor(lattice.shape, device=blocks.device)
    at_border = ((blocks + 1) * size >= shape).any(1) | (blocks[:, 1:] == 0).any(1)
    return blocks[(values.abs() <= reach + margin) | (at_border & (values > -margin))]


def child_blocks(blocks: Int[Tensor, "block 3"], size: int, lattice: BCCLattice) -> Int[Tensor, "child 3"]:
    """The eight blocks of ``size`` cells inside each block of twice the size, those beyond the box left out."""
    if in_kernels(blocks):
        assert kernels is not None
        return torch.from_numpy(kernels.children(blocks.numpy(), size, np.array(lattice.shape)))
    shape = torch.tensor(lattice.shape, device=blocks.device)
    blocks = (2 * blocks[:, None] + _CORNERS.to(blocks.device)).flatten(0, 1)
    return blocks[(blocks * size < shape).all(1)]


def bricks_around(cells: Int[Tensor, "cell 3"], bricks: Bricks) -> Bool[Tensor, " box_brick"]:
    """Marks of the box's bricks that hold the corners and the centres of cells and of all cells that touch them."""
    wanted = torch.zeros_like(bricks.table, dtype=torch.bool)
    if in_kernels(cells):
        assert kernels is not None
        kernels.mark_bricks(cells.numpy(), wanted.numpy(), bricks.grid)
        return wanted
    limits = torch.tensor(bricks.lattice.shape, device=cells.device)
    signs = 2 * _CORNERS.to(cells.device) - 1
    reach = (cells[:, None] + signs).clamp(min=torch.zeros_like(limits), max=limits)
    wanted[bricks.place_in_box(reach // EDGE)] = True
    return wanted


def half_steps(points: Int[Tensor, " point"], bricks: Bricks) -> Int[Tensor, "point 3"]:
    """Coordinates of points in half cells, see :meth:`BCCLattice.half_steps`."""
    if in_kernels(points):
        assert kernels is not None
        return torch.from_numpy(kernels.half_steps(points.numpy(), bricks.origins.numpy()))
    return bricks.half_steps(points)


def surroundings(cells: Int[Tensor, "cell 3"], bricks: Bricks) -> Bool[Tensor, " point"]:
    """Marks of the points that decide all tetrahedra of cells: their corners and centres, the neighbours' centres."""
    wanted = torch.zeros(len(bricks), dtype=torch.bool, device=cells.device)
    if in_kernels(cells):
        assert kernels is not None
        kernels.mark_surroundings(cells.numpy(), wanted.numpy(), bricks.table.numpy(), bricks.grid)
        return wanted
    wanted[bricks.corner_number(cells[:, None] + _CORNERS.to(cells.device)).flatten()] = True
    around = (cells[:, None] + _NEIGHBOURS.to(cells.device)).flatten(0, 1)
    wanted[bricks.centre_number(around[bricks.lattice.contains(around)])] = True
    return wanted


def behind(
    cells: Int[Tensor, "cell 3"], bricks: Bricks, inside: Bool[Tensor, " point"], active: Bool[Tensor, " point"]
) -> Bool[Tensor, " point"]:
    """Marks of the centres of inactive cells that see the surface through their face to one of ``cells``."""
    fresh = torch.zeros_like(active)
    if in_kernels(cells):
        assert kernels is not None
        marks = fresh.numpy(), inside.numpy(), active.numpy(), bricks.table.numpy()
        kernels.mark_behind(cells.numpy(), *marks, bricks.grid, RINGS.numpy())
        return fresh
    for axis in range(3):
        for side in (0, 1):
            fresh[_behind_face(cells, bricks, inside, active, axis, side)] = True
    return fresh


def _behind_face(cells: Tensor, bricks: Bricks, inside: Tensor, active: Tensor, axis: int, side: int) -> Tensor:
    step = torch.eye(3, dtype=torch.long, device=cells.device)[axis]
    neighbour = cells + (2 * side - 1) * step
    rows = bricks.lattice.contains(neighbour).nonzero()[:, 0]
    number = bricks.centre_number(neighbour[rows])
    idle = ~active[number]
    rows, number = rows[idle], number[idle]
    corners = bricks.corner_number(cells[rows][:, None] + RINGS[axis].to(cells.device) + side * step)
    sides = inside[torch.cat((corners, number[:, None]), dim=1)]
    return number[sides.any(1) & ~sides.all(1)]
