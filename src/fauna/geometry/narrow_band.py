"""Which cells of a lattice the surface passes through, found with few evaluations of the signed distance."""

from collections.abc import Callable
from itertools import product
from math import ceil, log2, sqrt

import torch
from torch import Tensor

from fauna.geometry.lattice import BCCLattice, face_ring

SDF = Callable[[Tensor], Tensor]
"""Maps (point, 3) world coordinates to (point,) signed distances, > 0 inside, even in x."""

CHUNK = 4096
"""Rows evaluated at once without gradient: activations stay in the cache."""

_CORNERS = torch.tensor(list(product((0, 1), repeat=3)))


class NarrowBand:
    """Signs of a signed distance at the lattice points around its zero level, computed as they are asked for.

    Attributes:
        known: (point,) whether the sign at a lattice point has been computed.
        inside: (point,) whether the signed distance is > 0 there, the border being outside.
        active: (cell,) cells the surface may pass through.
        evaluations: points evaluated so far.
    """

    def __init__(self, sdf: SDF, lattice: BCCLattice, offset: Tensor) -> None:
        self.sdf, self.lattice, self.offset = sdf, lattice, offset
        self.evaluations = 0
        points = lattice.num_corners + lattice.num_cells
        self.known = torch.zeros(points, dtype=torch.bool, device=offset.device)
        self.inside = torch.zeros_like(self.known)
        self.active = torch.zeros(lattice.num_cells, dtype=torch.bool, device=offset.device)

    def find_cells(self, bound: float, coarse_cells: int, coarse_sdf: SDF, margin: float) -> None:
        """Activate the cells that may contain a zero, from coarse blocks to cells.

        A block of edge h stays when its centre value is at most ``bound * sqrt(3) / 2 * h``, or when it touches the
        border, where lattice values are forced outside, with its centre inside.

        Args:
            bound: assumed Lipschitz constant.
            coarse_cells: blocks along the longest axis to start from, at least.
            coarse_sdf: used for blocks larger than a cell.
            margin: its largest error, world units.
        """
        lattice = self.lattice
        level = max(0, int(log2(max(lattice.shape) / min(coarse_cells, max(lattice.shape)))))
        blocks = torch.cartesian_prod(*(torch.arange(ceil(n / 2**level)) for n in lattice.shape)).to(self.active.device)
        while level > 0:
            value = self._evaluate(coarse_sdf, lattice.embed((2 * blocks + 1) * 2**level, self.offset))
            blocks = self._split(blocks[self._may_cross(blocks, 2**level, value, bound, margin)], 2 ** (level - 1))
            level -= 1
        value = self._evaluate(self.sdf, lattice.embed(2 * blocks + 1, self.offset))
        self._store(lattice.cell_number(blocks) + lattice.num_corners, value)
        blocks = blocks[self._may_cross(blocks, 1, value, bound, 0.0)]
        self.active[lattice.cell_number(blocks)] = True
        self._learn(self._surroundings(blocks))

    def _may_cross(self, blocks: Tensor, size: int, value: Tensor, bound: float, margin: float) -> Tensor:
        """Whether blocks of ``size`` cells, with ``value`` at their centres, may hold a sign change."""
        shape = torch.tensor(self.lattice.shape, device=blocks.device)
        reach = bound * sqrt(3) / 2 * size * self.lattice.cell_size + margin
        at_border = ((blocks + 1) * size >= shape).any(1) | (blocks[:, 1:] == 0).any(1)
        return (value.abs() <= reach) | (at_border & (value > 0))

    def _split(self, blocks: Tensor, size: int) -> Tensor:
        """The eight blocks of ``size`` cells inside each block, those beyond the box left out."""
        shape = torch.tensor(self.lattice.shape, device=blocks.device)
        blocks = (2 * blocks[:, None] + _CORNERS.to(blocks.device)).flatten(0, 1)
        return blocks[(blocks * size < shape).all(1)]

    def flood(self) -> int:
        """Activate neighbours behind faces the surface passes through until there is none; returns the rounds."""
        lattice, rounds = self.lattice, 0
        front = lattice.cell_index(self.active.nonzero()[:, 0])
        while True:
            found = [self._behind(front, axis, side) for axis in range(3) for side in (0, 1)]
            fresh = torch.zeros_like(self.active)
            fresh[torch.cat(found)] = True
            front = lattice.cell_index(fresh.nonzero()[:, 0])
            if len(front) == 0:
                return rounds
            self.active |= fresh
            self._learn(self._surroundings(front))
            rounds += 1

    def _behind(self, cells: Tensor, axis: int, side: int) -> Tensor:
        """Inactive neighbours across one face of ``cells`` that see the surface through it."""
        lattice = self.lattice
        neighbour = cells.clone()
        neighbour[:, axis] += 2 * side - 1
        number = lattice.cell_number(neighbour)
        rows = lattice.contains(neighbour).nonzero()[:, 0]
        rows = rows[~self.active[number[rows]]]
        number = number[rows]
        ring = face_ring(axis).to(cells.device)
        ring[:, axis] = side
        corners = lattice.corner_number(cells[rows][:, None] + ring)
        inside = self.inside[torch.cat((corners, (number + lattice.num_corners)[:, None]), dim=1)]
        return number[inside.any(1) & ~inside.all(1)]

    def _surroundings(self, cells: Tensor) -> Tensor:
        """Points needed to judge all tetrahedra of cells: their corners, their centre, the neighbours' centres."""
        lattice = self.lattice
        corners = lattice.corner_number(cells[:, None] + _CORNERS.to(cells.device)).flatten()
        steps = torch.cat((torch.zeros(1, 3, dtype=torch.long), torch.eye(3, dtype=torch.long)))
        steps = torch.cat((steps, -steps[1:])).to(cells.device)
        around = (cells[:, None] + steps).flatten(0, 1)
        around = around[lattice.contains(around)]
        return torch.cat((corners, lattice.cell_number(around) + lattice.num_corners))

    def _learn(self, points: Tensor) -> None:
        """Evaluate those of ``points`` that are not known yet."""
        wanted = torch.zeros_like(self.known)
        wanted[points] = True
        points = (wanted & ~self.known).nonzero()[:, 0]
        self._store(points, self._evaluate(self.sdf, self.lattice.positions(points, self.offset)))

    def _evaluate(self, sdf: SDF, points: Tensor) -> Tensor:
        """Values at positions, in chunks."""
        self.evaluations += len(points)
        return torch.cat([sdf(chunk) for chunk in points.split(CHUNK)]) if len(points) > CHUNK else sdf(points)

    def _store(self, points: Tensor, values: Tensor) -> None:
        self.inside[points] = self.lattice.close(points, values) > 0
        self.known[points] = True
