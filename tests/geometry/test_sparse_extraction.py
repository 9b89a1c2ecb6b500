import pytest
import torch

from fauna.errors import FaunaError
from fauna.geometry import narrow_band
from fauna.geometry.lattice import BCCLattice
from fauna.geometry.marching_tets import face_components
from fauna.geometry.sparse_extraction import EmptyMeshError, extract_dense, extract_sparse
from fauna.shape.sdf_mlp import SDFNetwork

OPTIONS = {"lipschitz": 1.5, "coarse_cells": 8}
OFFSET = torch.tensor([0.0, 0.031, -0.017])


def ellipsoid(points):
    return 1.05 - (points * torch.tensor([1.0, 1.0, 0.5], dtype=points.dtype)).norm(dim=1)


def capsule(points, start, end, radius):
    start, end = (torch.tensor(p, dtype=points.dtype) for p in (start, end))
    along = ((points - start) @ (end - start) / (end - start).square().sum()).clamp(0, 1)
    return radius - (points - start - along[:, None] * (end - start)).norm(dim=1)


def animal(points):
    """Ellipsoid body, four legs, a tail thinner than most lattices and two ears."""
    points = torch.cat((points[:, :1].abs(), points[:, 1:]), dim=1)
    body = 0.6 - (points * torch.tensor([1.0, 1.0, 0.5], dtype=points.dtype)).norm(dim=1)
    parts = [
        capsule(points, (0.35, 0.0, 0.8), (0.35, -1.5, 0.8), 0.15),
        capsule(points, (0.35, 0.0, -0.8), (0.35, -1.5, -0.9), 0.12),
        capsule(points, (0.0, 0.0, -1.1), (0.0, 0.9, -2.0), 0.05),
        capsule(points, (0.2, 0.2, 0.9), (0.3, 0.9, 1.2), 0.07),
    ]
    return torch.stack([body, *parts]).amax(dim=0)


def random_network(gain, hidden_dim=32):
    torch.manual_seed(0)
    network = SDFNetwork(
        embedding_dim=16,
        num_octaves=6,
        base_frequency=0.8,
        hidden_dim=hidden_dim,
        num_layers=4,
        ellipsoid_radii=(1.05, 1.05, 2.1),
        ellipsoid_lift=0.0,
        legs=None,
        residual_scale=gain,
        style_offset=1.0,
        demodulation_eps=1e-5,
    )
    return network, torch.randn(16)


def network_sdf(gain):
    network, embedding = random_network(gain)
    return network(embedding)


def canonical(verts, faces):
    """Vertices in lexicographic order and the set of faces, each starting at its smallest vertex."""
    order = sorted(range(len(verts)), key=verts.tolist().__getitem__)
    rank = torch.empty(len(verts), dtype=torch.long)
    rank[order] = torch.arange(len(verts))
    rows = rank[faces]
    start = rows.argmin(dim=1, keepdim=True)
    return verts[order], {tuple(row) for row in rows.gather(1, (start + torch.arange(3)) % 3).tolist()}


def assert_closed(verts, faces):
    directed = torch.cat([faces[:, [i, (i + 1) % 3]] for i in range(3)])
    unique, counts = torch.unique(directed, dim=0, return_counts=True)
    assert (counts == 1).all()
    assert torch.equal(torch.unique(unique.flip(1), dim=0), unique)
    assert torch.unique(faces).numel() == len(verts)


SDFS = {
    "ellipsoid": lambda: ellipsoid,
    "animal": lambda: animal,
    "mlp": lambda: network_sdf(0.3),
    "mlp x3": lambda: network_sdf(1.0),
}


@pytest.mark.parametrize("name", SDFS)
@pytest.mark.parametrize("cells", [13, 26])
def test_same_mesh_as_dense(name, cells):
    sdf = SDFS[name]()
    lattice = BCCLattice(cell_size=5 / cells, half_extents=(2.0, 2.5, 2.5))
    with torch.no_grad():
        dense = extract_dense(sdf, lattice, OFFSET)
        verts, faces, stats = extract_sparse(sdf, lattice, OFFSET, **OPTIONS)
    dense_verts, dense_faces = canonical(*dense)
    sparse_verts, sparse_faces = canonical(verts, faces)
    torch.testing.assert_close(sparse_verts, dense_verts, rtol=0, atol=1e-5)
    assert sparse_faces == dense_faces
    assert len(faces) == len(sparse_faces) > 100
    assert stats.evaluations < lattice.num_cells + lattice.num_corners + 1000
    assert stats.retries == 0


def test_few_evaluations_on_a_fine_lattice():
    lattice = BCCLattice(cell_size=7 / 52, half_extents=(3.5, 3.5, 3.5))
    _, _, stats = extract_sparse(ellipsoid, lattice, OFFSET, **OPTIONS)
    assert stats.evaluations + stats.grad_evaluations < 0.1 * (lattice.num_cells + lattice.num_corners)


def test_same_gradients_as_dense():
    network, embedding = random_network(0.3)
    embedding.requires_grad_()
    lattice = BCCLattice(cell_size=5 / 13, half_extents=(2.0, 2.5, 2.5))
    direction = torch.tensor([0.3, -0.2, 0.9])
    gradients = []
    for extract in (extract_dense, lambda *args: extract_sparse(*args, **OPTIONS)):
        verts = extract(network(embedding), lattice, OFFSET)[0]
        loss = torch.sin(3 * verts @ direction).sum()
        gradients.append(torch.autograd.grad(loss, [embedding, *network.modulated.parameters()]))
    for dense, sparse in zip(*gradients, strict=True):
        assert dense.abs().max() > 0
        torch.testing.assert_close(sparse, dense, rtol=1e-4, atol=1e-4 * float(dense.abs().max()))


def test_gradcheck_through_the_extraction():
    lattice = BCCLattice(cell_size=0.5, half_extents=(1.5, 1.5, 1.5))
    offset = OFFSET.double()

    def vertices(radii):
        return extract_sparse(lambda p: 1 - (p / radii).norm(dim=1), lattice, offset, **OPTIONS)[0]

    radii = torch.tensor([0.83, 0.91, 1.07], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(vertices, (radii,))


@pytest.mark.parametrize("name", SDFS)
def test_closed_outward_and_exactly_symmetric(name):
    lattice = BCCLattice(cell_size=5 / 20, half_extents=(2.0, 2.5, 2.5))
    verts, faces, _ = extract_sparse(SDFS[name](), lattice, OFFSET, **OPTIONS)
    verts = verts.detach()
    assert_closed(verts, faces)
    assert torch.linalg.det(verts[faces]).sum() > 0
    flipped = verts * torch.tensor([-1.0, 1.0, 1.0])
    assert sorted(flipped.tolist()) == sorted(verts.tolist())
    image = torch.tensor([sorted(range(len(verts)), key=flipped.tolist().__getitem__)])[0]
    order = torch.tensor(sorted(range(len(verts)), key=verts.tolist().__getitem__))
    partner = torch.empty_like(order)
    partner[image] = order
    one_sided = (verts[faces][..., 0] >= 0).all(dim=1) | (verts[faces][..., 0] <= 0).all(dim=1)
    _, whole = canonical(verts, faces)
    _, mirrored = canonical(flipped, partner.new_tensor(faces.flip(1).tolist()))
    assert len(whole ^ mirrored) <= 2 * int((~one_sided).sum())


def test_vertices_lie_on_the_surface():
    lattice = BCCLattice(cell_size=5 / 52, half_extents=(1.5, 1.5, 2.5))
    verts, faces, _ = extract_sparse(ellipsoid, lattice, OFFSET, **OPTIONS)
    assert ellipsoid(verts).abs().max() < 0.01
    volume = float(torch.linalg.det(verts[faces]).sum() / 6)
    assert volume == pytest.approx(4 / 3 * torch.pi * 1.05**2 * 2.1, rel=0.01)
    assert len(verts) - len(faces) * 3 // 2 + len(faces) == 2


BOX_FILLING = {"large": lambda p: 3 - p.norm(dim=1), "everywhere": lambda p: torch.full_like(p[:, 0], 10.0)}


@pytest.mark.parametrize("name", BOX_FILLING)
def test_surface_leaving_the_box_is_closed(name):
    sdf = BOX_FILLING[name]
    lattice = BCCLattice(cell_size=0.3, half_extents=(1.5, 2.0, 2.5))
    verts, faces, stats = extract_sparse(sdf, lattice, OFFSET, **OPTIONS)
    assert stats.retries == 0
    assert_closed(verts, faces)
    dense_verts, dense_faces = canonical(*extract_dense(sdf, lattice, OFFSET))
    sparse_verts, sparse_faces = canonical(verts, faces)
    assert torch.equal(sparse_verts, dense_verts)
    assert sparse_faces == dense_faces


def test_flood_repairs_a_violated_bound():
    """A function four times as steep as the bound allows is still complete, thanks to the flood."""
    lattice = BCCLattice(cell_size=5 / 26, half_extents=(1.5, 2.0, 2.4))

    def steep(points):
        bumps = torch.cos(2 * points[:, 0]) * torch.sin(2 * points[:, 1:]).sum(dim=1)
        return 4 * (ellipsoid(points) + 0.3 * bumps)

    verts, faces, stats = extract_sparse(steep, lattice, OFFSET, lipschitz=0.6, coarse_cells=8)
    dense_verts, dense_faces = canonical(*extract_dense(steep, lattice, OFFSET))
    sparse_verts, sparse_faces = canonical(verts, faces)
    assert stats.flood_rounds > 0
    torch.testing.assert_close(sparse_verts, dense_verts, rtol=0, atol=1e-5)
    assert sparse_faces == dense_faces


def test_second_attempt_and_empty_mesh():
    lattice = BCCLattice(cell_size=0.2, half_extents=(1.0, 1.0, 1.0))

    def pin(points):
        return 3.5 * (0.2 - points.norm(dim=1))

    _, faces, stats = extract_sparse(pin, lattice, torch.zeros(3), lipschitz=0.2, coarse_cells=2)
    assert len(faces) > 0
    assert stats.retries == 1
    with pytest.raises(EmptyMeshError, match="found none"):
        extract_sparse(lambda p: -p.norm(dim=1) - 1, lattice, torch.zeros(3), **OPTIONS)


def test_offset_along_x_is_refused():
    lattice = BCCLattice(cell_size=0.5, half_extents=(1.0, 1.0, 1.0))
    with pytest.raises(FaunaError, match="offset along x"):
        extract_sparse(ellipsoid, lattice, torch.tensor([0.1, 0.0, 0.0]), **OPTIONS)


def test_coarse_start_and_chunk_size_do_not_matter(monkeypatch):
    lattice = BCCLattice(cell_size=5 / 26, half_extents=(2.0, 2.5, 2.5))
    sdf = network_sdf(0.3)
    reference = canonical(*extract_sparse(sdf, lattice, OFFSET, **OPTIONS)[:2])
    for chunk, coarse_cells in ((97, 8), (4096, 4), (4096, 1000)):
        monkeypatch.setattr(narrow_band, "CPU_CHUNK", chunk)
        verts, faces = canonical(*extract_sparse(sdf, lattice, OFFSET, lipschitz=1.5, coarse_cells=coarse_cells)[:2])
        torch.testing.assert_close(verts, reference[0], rtol=0, atol=1e-5)
        assert faces == reference[1]


def test_bfloat16_blocks_give_the_same_mesh():
    lattice = BCCLattice(cell_size=5 / 26, half_extents=(2.0, 2.5, 2.5))
    sdf = network_sdf(0.3)
    reference = extract_sparse(sdf, lattice, OFFSET, **OPTIONS)
    coarse = extract_sparse(sdf, lattice, OFFSET, **OPTIONS, approximation=sdf.coarse)
    torch.testing.assert_close(coarse[0], reference[0], rtol=0, atol=0)
    assert torch.equal(coarse[1], reference[1])


def test_bitwise_repeatable():
    network, embedding = random_network(0.3)
    lattice = BCCLattice(cell_size=5 / 26, half_extents=(2.0, 2.5, 2.5))
    torch.use_deterministic_algorithms(True)
    try:
        results = []
        for _ in range(2):
            verts, faces, _ = extract_sparse(network(embedding), lattice, OFFSET, **OPTIONS)
            gradients = torch.autograd.grad(verts.square().sum(), list(network.modulated.parameters()))
            results.append((verts, faces, *gradients))
    finally:
        torch.use_deterministic_algorithms(False)
    for first, second in zip(*results, strict=True):
        assert torch.equal(first, second)


def test_islands_are_found():
    lattice = BCCLattice(cell_size=0.2, half_extents=(2.0, 2.0, 2.0))

    def islands(points):
        folded = torch.cat((points[:, :1].abs(), points[:, 1:]), dim=1)
        centres = torch.tensor([[1.2, 1.2, 1.2], [1.2, -1.0, -1.2], [0.0, 0.0, 0.0]])
        return 0.3 - torch.cdist(folded, centres).amin(dim=1)

    verts, faces, _ = extract_sparse(islands, lattice, OFFSET, **OPTIONS)
    assert int(face_components(faces, len(verts)).max()) + 1 == 5


def test_no_distance_function_escapes_an_exact_bound():
    """Balls two cells wide, anywhere, are found from the coarsest blocks with a bound of exactly 1."""
    lattice = BCCLattice(cell_size=0.15, half_extents=(2.4, 2.4, 2.4))
    centres = 1.9 * (2 * torch.rand(20, 3, generator=torch.Generator().manual_seed(0)) - 1)
    for centre in centres:
        centre[0] = centre[0].abs()

        def ball(points, centre=centre):
            folded = torch.cat((points[:, :1].abs(), points[:, 1:]), dim=1)
            return 0.15 - (folded - centre).norm(dim=1)

        _, faces, stats = extract_sparse(ball, lattice, torch.zeros(3), lipschitz=1.0, coarse_cells=1)
        assert len(faces) > 0
        assert stats.retries == 0
        assert stats.flood_rounds == 0
