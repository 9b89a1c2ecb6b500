"""Numbers for the lattice points near a surface, so that no array of marks is as large as the lattice."""

import numpy as np
import torch
from jaxtyping import Bool, Int
from torch import Tensor

from fauna.geometry.lattice import BCCLattice

EDGE = 4
"""Cells along an edge of a brick."""

POINTS = 2 * EDGE**3
"""Lattice points of a brick: the low corners of its cells, then their centres."""


class Bricks:
    """Numbers for the lattice points near given cells, dense enough to index marks.

    A point's number is ``POINTS * brick + place in the brick``; bricks are numbered as they are allocated, those of one
    call in raster order. Only ``table``, one entry per brick of the box, grows with the volume.

    Attributes:
        table: (brick of the box,) number of each brick, -1 where there is none.
        origins: (brick, 3) first cell of each brick.
        grid: (6,) cells along the three axes of the lattice, then bricks; as the kernels want them.
    """

    def __init__(self, lattice: BCCLattice, device: torch.device) -> None:
        self.lattice = lattice
        self.counts = tuple(cells // EDGE + 1 for cells in lattice.shape)
        self.grid = np.array((*lattice.shape, *self.counts))
        nx, ny, nz = self.counts
        self.table = torch.full((nx * ny * nz,), -1, device=device)
        self.origins = torch.empty(0, 3, dtype=torch.long, device=device)

    def __len__(self) -> int:
        """Numbers handed out: marks need so many entries."""
        return POINTS * len(self.origins)

    def allocate(self, wanted: Bool[Tensor, " box_brick"]) -> None:
        """Add the bricks of the box that are ``wanted`` and not there yet."""
        fresh = (wanted & (self.table < 0)).nonzero()[:, 0]
        self.table[fresh] = len(self.origins) + torch.arange(len(fresh), device=fresh.device)
        _, ny, nz = self.counts
        origins = EDGE * torch.stack((fresh // (ny * nz), fresh // nz % ny, fresh % nz), dim=1)
        self.origins = torch.cat((self.origins, origins))

    def corner_number(self, index: Int[Tensor, "*corner 3"]) -> Int[Tensor, "*corner"]:
        """Number of corners at grid positions (i, j, k); negative where no brick is allocated."""
        i, j, k = (index % EDGE).unbind(dim=-1)
        return self.table[self.place_in_box(index // EDGE)] * POINTS + (i * EDGE + j) * EDGE + k

    def centre_number(self, index: Int[Tensor, "*cell 3"]) -> Int[Tensor, "*cell"]:
        """Number of the centres of cells (i, j, k); negative where no brick is allocated."""
        return self.corner_number(index) + POINTS // 2

    def half_steps(self, numbers: Int[Tensor, " point"]) -> Int[Tensor, "point 3"]:
        """Coordinates in half cells, see :meth:`BCCLattice.half_steps`."""
        place = numbers % (POINTS // 2)
        index = torch.stack((place // EDGE**2, place // EDGE % EDGE, place % EDGE), dim=1)
        centre = numbers % POINTS >= POINTS // 2
        return 2 * (self.origins[numbers // POINTS] + index) + centre[:, None]

    def place_in_box(self, brick: Int[Tensor, "*point 3"]) -> Int[Tensor, "*point"]:
        """Index into ``table`` of bricks given by position."""
        _, ny, nz = self.counts
        i, j, k = brick.unbind(dim=-1)
        return (i * ny + j) * nz + k
