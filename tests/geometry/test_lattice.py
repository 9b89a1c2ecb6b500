import pytest
import torch

from fauna.geometry.lattice import BCCLattice, cell_size_of, explicit_lattice, face_ring

LATTICE = BCCLattice(cell_size=0.5, half_extents=(1.0, 0.75, 1.0))
OFFSET = torch.tensor([0.0, 0.03, -0.02], dtype=torch.float64)


def test_paper_grid_has_104_cells():
    lattice = BCCLattice(cell_size=cell_size_of(7.0, 256), half_extents=(3.5, 3.5, 3.5))
    assert lattice.shape == (52, 104, 104)
    points = 2 * (lattice.num_corners + lattice.num_cells) - 105 * 105
    assert points == 2_282_489  # measured for n = 104 cells


def test_laptop_grid_is_rounded_to_whole_cells():
    lattice = BCCLattice(cell_size=cell_size_of(5.0, 64), half_extents=(1.35, 2.3, 2.4))
    assert lattice.shape == (7, 24, 25)
    assert lattice.box == pytest.approx((7 * 5 / 26, 12 * 5 / 26, 12.5 * 5 / 26))


def test_positions_by_hand():
    nx, ny, nz = LATTICE.shape
    corner = [
        [i * 0.5, (j - ny / 2) * 0.5, (k - nz / 2) * 0.5]
        for i in range(nx + 1)
        for j in range(ny + 1)
        for k in range(nz + 1)
    ]
    centre = [
        [(i + 0.5) * 0.5, (j + 0.5 - ny / 2) * 0.5, (k + 0.5 - nz / 2) * 0.5]
        for i in range(nx)
        for j in range(ny)
        for k in range(nz)
    ]
    expected = torch.tensor(corner + centre, dtype=torch.float64) + OFFSET
    points = torch.arange(LATTICE.num_corners + LATTICE.num_cells)
    torch.testing.assert_close(LATTICE.positions(points, OFFSET), expected)


def test_numbers_are_inverse_to_indices():
    cells = torch.arange(LATTICE.num_cells)
    assert torch.equal(LATTICE.cell_number(LATTICE.cell_index(cells)), cells)
    points = torch.arange(LATTICE.num_corners + LATTICE.num_cells)
    assert torch.equal(LATTICE.number(LATTICE.half_steps(points)), points)
    assert LATTICE.contains(LATTICE.cell_index(cells)).all()
    assert not LATTICE.contains(torch.tensor([[2, 0, 0], [0, -1, 0], [0, 0, 4]])).any()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_face_ring_turns_counter_clockwise(axis):
    ring = face_ring(axis).double()
    normal = torch.linalg.cross(ring[1] - ring[0], ring[2] - ring[1])
    assert torch.equal(normal, torch.eye(3, dtype=torch.float64)[axis])


def test_tetrahedra_are_congruent_and_oriented():
    explicit = explicit_lattice(LATTICE)
    verts = explicit.positions(LATTICE, OFFSET)
    corners = verts[explicit.tets]
    volume = torch.linalg.det(corners[:, 1:] - corners[:, :1]) / 6
    torch.testing.assert_close(volume.abs(), torch.full_like(volume, 0.5**3 / 12))
    has_mirrored = (corners[..., 0] < 0).all(dim=1) | ((corners[..., 0] <= 0).all(dim=1))
    assert torch.equal(volume < 0, has_mirrored)


def test_tetrahedra_tile_the_interior_once():
    """Every triangle belongs to two tetrahedra, or to one when all its corners are border points."""
    explicit = explicit_lattice(LATTICE)
    triangles = torch.cat([explicit.tets[:, [i for i in range(4) if i != skip]] for skip in range(4)]).sort(1).values
    unique, count = torch.unique(triangles, dim=0, return_counts=True)
    assert count.max() == 2
    border = LATTICE.border(LATTICE.half_steps(explicit.points))
    assert border[unique[count == 1]].all()
    inner = ~border[unique].all(dim=1)
    assert (count[inner] == 2).all()


def test_lattice_is_mirror_symmetric():
    explicit = explicit_lattice(LATTICE)
    verts = explicit.positions(LATTICE, OFFSET)
    flipped = verts * torch.tensor([-1.0, 1.0, 1.0])
    image = (flipped[:, None] == verts[None]).all(-1).float().argmax(1)
    assert torch.equal(verts[image], flipped)
    tets = {tuple(sorted(t)) for t in explicit.tets.tolist()}
    assert {tuple(sorted(t)) for t in image[explicit.tets].tolist()} == tets


def test_closing_only_touches_the_border():
    points = torch.arange(LATTICE.num_corners + LATTICE.num_cells)
    steps = LATTICE.half_steps(points)
    closed = LATTICE.close(steps, torch.ones(len(points)))
    assert torch.equal(closed < 0, LATTICE.border(steps))
    assert not LATTICE.border(steps[steps[:, 0] == 0]).all()
