import torch

from fauna.geometry import band_ops
from fauna.geometry.bricks import POINTS, Bricks
from fauna.geometry.lattice import BCCLattice

LATTICE = BCCLattice(cell_size=0.5, half_extents=(4.5, 2.5, 3.0))
CELLS = torch.tensor([[0, 0, 0], [8, 9, 11], [4, 5, 3], [3, 3, 4]])


def bricks_for(cells):
    bricks = Bricks(LATTICE, torch.device("cpu"))
    bricks.allocate(band_ops.bricks_around(cells, bricks))
    return bricks


def test_numbers_are_distinct_and_lead_back():
    bricks = bricks_for(LATTICE.cell_index(torch.arange(LATTICE.num_cells)))
    every = torch.arange(LATTICE.num_corners + LATTICE.num_cells)
    steps = LATTICE.half_steps(every)
    corner = every < LATTICE.num_corners
    numbers = torch.where(corner, bricks.corner_number(steps // 2), bricks.centre_number(steps // 2))
    assert numbers.min() >= 0
    assert len(torch.unique(numbers)) == len(every)
    assert torch.equal(bricks.half_steps(numbers), steps)
    assert torch.equal(band_ops.half_steps(numbers, bricks), steps)


def test_every_point_around_a_cell_has_a_number_and_far_ones_do_not():
    bricks = bricks_for(CELLS)
    for cell in CELLS.tolist():
        for step in torch.cartesian_prod(*[torch.arange(-1, 2)] * 3):
            other = torch.tensor([cell]) + step
            if LATTICE.contains(other).all():
                assert bricks.centre_number(other) >= 0
        corners = torch.tensor(cell) + torch.cartesian_prod(*[torch.arange(2)] * 3)
        assert (bricks.corner_number(corners) >= 0).all()
    assert bricks.centre_number(torch.tensor([[8, 0, 0]])) < 0
    assert bricks.corner_number(torch.tensor([[8, 0, 11]])) < 0


def test_later_bricks_leave_earlier_numbers_alone():
    bricks = bricks_for(CELLS[:1])
    before, count = bricks.centre_number(CELLS[:1]), len(bricks)
    bricks.allocate(band_ops.bricks_around(CELLS, bricks))
    assert torch.equal(bricks.centre_number(CELLS[:1]), before)
    assert len(bricks) > count
    assert len(bricks) % POINTS == 0
    bricks.allocate(band_ops.bricks_around(CELLS, bricks))
    assert len(bricks) == POINTS * len(torch.unique(bricks.origins, dim=0))
