"""Which cells of a lattice the surface passes through, found with few evaluations of the signed distance."""

from collections.abc import Callable
from math import ceil, log2, sqrt

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fauna.geometry.band_ops import behind, bricks_around, child_blocks, half_steps, kept_blocks, surroundings
from fauna.geometry.bricks import Bricks
from fauna.geometry.lattice import BCCLattice

SDF = Callable[[Tensor], Tensor]
"""Maps (point, 3) world coordinates to (point,) signed distances, > 0 inside, even in x."""

CPU_CHUNK = 1024
"""Rows evaluated at once on a CPU: activations stay in the cache."""

GPU_CHUNK = 65536
"""The same elsewhere: bounds the memory."""

CALIBRATION_POINTS = 128
"""Points at which an approximate signed distance is compared with the exact one."""

CALIBRATION_SAFETY = 8.0
"""Its error is taken to be so many times the largest one seen there."""


def in_chunks(sdf: SDF, points: Float[Tensor, "point 3"]) -> Float[Tensor, " point"]:
    """``sdf(points)``, so many rows at a time as suit the device."""
    size = CPU_CHUNK if points.device.type == "cpu" else GPU_CHUNK
    return torch.cat([sdf(chunk) for chunk in points.split(size)]) if len(points) > size else sdf(points)


class SignSource:
    """Values of a signed distance, cheap wherever they decide the sign.

    Attributes:
        exact: the signed distance.
        cheap: its approximation, or the same.
        margin: () largest error of ``cheap``, world units; 0 until :meth:`calibrate`.
        evaluations: points evaluated so far, by either.
        exact_evaluations: those evaluated by ``exact``.
    """

    def __init__(self, exact: SDF, approximate: SDF | None, margin: Float[Tensor, ""]) -> None:
        self.exact = exact
        self.cheap = approximate or exact
        self.margin = margin
        self.evaluations = self.exact_evaluations = 0

    @property
    def approximate(self) -> bool:
        """Whether there is an approximation."""
        return self.cheap is not self.exact

    def calibrate(self, points: Float[Tensor, "point 3"], values: Float[Tensor, " point"]) -> None:
        """Set the margin from cheap values, given, and exact ones at some of the points."""
        if self.approximate:
            some = slice(None, None, ceil(len(points) / CALIBRATION_POINTS))
            self.margin = CALIBRATION_SAFETY * (self.refined(points[some]) - values[some]).abs().max()

    def values(self, points: Float[Tensor, "point 3"]) -> Float[Tensor, " point"]:
        """Signed distances, off by at most ``margin``."""
        self.evaluations += len(points)
        self.exact_evaluations += 0 if self.approximate else len(points)
        return in_chunks(self.cheap, points)

    def refined(self, points: Float[Tensor, "point 3"]) -> Float[Tensor, " point"]:
        """Exact signed distances."""
        self.evaluations += len(points)
        self.exact_evaluations += len(points)
        return in_chunks(self.exact, points)

    def signed(self, points: Float[Tensor, "point 3"]) -> Float[Tensor, " point"]:
        """Signed distances of which the signs are exact."""
        values = self.values(points)
        if self.approximate:
            unsure = (values.abs() <= self.margin).nonzero()[:, 0]
            values[unsure] = self.refined(points[unsure])
        return values


class NarrowBand:
    """Signs of a signed distance at the lattice points around its zero level, computed as they are asked for.

    All marks are indexed by the numbers of ``bricks``.

    Attributes:
        bricks: numbers of the points near the surface.
        known: (point,) whether the sign at a lattice point has been computed.
        inside: (point,) whether the signed distance is > 0 there, the border being outside.
        active: (point,) centres of the cells the surface may pass through.
    """

    def __init__(self, source: SignSource, lattice: BCCLattice, offset: Float[Tensor, "3"]) -> None:
        self.source, self.lattice, self.offset = source, lattice, offset
        self.bricks = Bricks(lattice, offset.device)
        self.known = torch.zeros(0, dtype=torch.bool, device=offset.device)
        self.inside = torch.zeros_like(self.known)
        self.active = torch.zeros_like(self.known)

    def find_cells(self, bound: float, coarse_cells: int) -> None:
        """Activate the cells that may contain a zero, from coarse blocks to cells.

        A block of edge h stays when its centre value is at most ``bound * sqrt(3) / 2 * h``, or when it touches the
        border, where lattice values are forced outside, with its centre inside.

        Args:
            bound: assumed Lipschitz constant.
            coarse_cells: blocks along the longest axis to start from, at least.
        """
        lattice = self.lattice
        level = max(0, int(log2(max(lattice.shape) / min(coarse_cells, max(lattice.shape)))))
        axes = (torch.arange(ceil(n / 2**level), device=self.offset.device) for n in lattice.shape)
        blocks = torch.cartesian_prod(*axes)
        points = lattice.embed((2 * blocks + 1) * 2**level, self.offset)
        values = self.source.values(points)
        self.source.calibrate(points, values)
        while level > 0:
            blocks = self._keep(blocks, 2**level, values, bound)
            level -= 1
            blocks = child_blocks(blocks, 2**level, lattice)
            values = self.source.values(lattice.embed((2 * blocks + 1) * 2**level, self.offset))
        cells = self._keep(blocks, 1, values, bound)
        self._make_room(cells)
        self._remember(blocks, values)
        self.active[self.bricks.centre_number(cells)] = True
        self._learn(cells)

    def _keep(self, blocks: Tensor, size: int, values: Tensor, bound: float) -> Tensor:
        """Those blocks of ``size`` cells, with ``values`` at their centres, that may hold a sign change."""
        reach = bound * sqrt(3) / 2 * size * self.lattice.cell_size
        return kept_blocks(blocks, values, size, reach, self.source.margin, self.lattice)

    def flood(self) -> int:
        """Activate neighbours behind faces the surface passes through until there is none; returns the rounds."""
        rounds, front = 0, self.cells()
        while True:
            fresh = behind(front, self.bricks, self.inside, self.active)
            front = self._cells_of(fresh)
            if len(front) == 0:
                return rounds
            self.active |= fresh
            self._make_room(front)
            self._learn(front)
            rounds += 1

    def cells(self) -> Int[Tensor, "cell 3"]:
        """Positions of the active cells."""
        return self._cells_of(self.active)

    def _cells_of(self, centres: Tensor) -> Tensor:
        return half_steps(centres.nonzero()[:, 0], self.bricks) // 2

    def _make_room(self, cells: Tensor) -> None:
        """Extend the marks to all points :meth:`_learn` may ask for around ``cells``."""
        self.bricks.allocate(bricks_around(cells, self.bricks))
        fresh = self.known.new_zeros(len(self.bricks) - len(self.known))
        self.known, self.inside, self.active = (torch.cat((m, fresh)) for m in (self.known, self.inside, self.active))

    def _remember(self, cells: Tensor, values: Tensor) -> None:
        """Keep what evaluated centres already say about the signs that will be asked for."""
        number = self.bricks.centre_number(cells)
        useful = number >= 0
        if self.source.approximate:
            useful &= values.abs() > self.source.margin
        self._store(number[useful], 2 * cells[useful] + 1, values[useful])

    def _learn(self, cells: Tensor) -> None:
        """Evaluate what is not known yet around ``cells``."""
        points = (surroundings(cells, self.bricks) & ~self.known).nonzero()[:, 0]
        steps = half_steps(points, self.bricks)
        self._store(points, steps, self.source.signed(self.lattice.embed(steps, self.offset)))

    def _store(self, points: Tensor, steps: Tensor, values: Tensor) -> None:
        self.inside[points] = self.lattice.close(steps, values) > 0
        self.known[points] = True
