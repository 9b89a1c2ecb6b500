"""Sparse and dense extraction agree whatever the network, the approximation, the chunks and the backend."""

import pytest
import torch

from fauna.geometry import band_march, band_ops, narrow_band
from fauna.geometry.lattice import BCCLattice
from fauna.geometry.narrow_band import NarrowBand, SignSource
from fauna.geometry.sparse_extraction import extract_dense, extract_sparse
from fauna.shape.sdf_mlp import SDFNetwork
from tests.geometry.test_sparse_extraction import assert_closed, canonical

LATTICE = BCCLattice(cell_size=5 / 13, half_extents=(2.0, 2.5, 2.5))
SMALL_BOX = BCCLattice(cell_size=5 / 13, half_extents=(0.8, 1.0, 1.5))
"""The surface leaves it on all sides."""
OPTIONS = {"lipschitz": 1.5, "coarse_cells": 4}
DIRECTION = torch.tensor([0.3, -0.2, 0.9])


def network(seed, hidden_dim=24):
    torch.manual_seed(seed)
    net = SDFNetwork(
        embedding_dim=8,
        num_octaves=5,
        base_frequency=0.8,
        hidden_dim=hidden_dim,
        num_layers=3 + seed % 2,
        ellipsoid_radii=(1.05, 1.05, 2.1),
        ellipsoid_lift=0.0,
        legs=None,
        residual_scale=(0.1, 0.3, 0.6)[seed % 3],
        style_offset=1.0,
        demodulation_eps=1e-5,
    )
    offset = torch.tensor([0.0, *(0.2 * (torch.rand(2) - 0.5)).tolist()])
    return net, torch.randn(8), offset


def gradients(net, code, verts):
    net.zero_grad()
    torch.sin(3 * verts @ DIRECTION).sum().backward()
    return torch.cat([p.grad.flatten() for p in net.parameters()])


def assert_same(first, second):
    (first_verts, first_faces), (second_verts, second_faces) = canonical(*first), canonical(*second)
    torch.testing.assert_close(first_verts, second_verts, rtol=0, atol=1e-5)
    assert first_faces == second_faces


def check(seed, lattice, bfloat16):
    net, code, offset = network(seed)
    dense = extract_dense(net(code), lattice, offset)
    expected = gradients(net, code, dense[0])
    field = net(code)
    cheap = field.coarse if bfloat16 else None
    verts, faces, stats = extract_sparse(field, lattice, offset, **OPTIONS, approximation=cheap)
    found = gradients(net, code, verts)
    assert len(faces) > 100
    assert_same((verts.detach(), faces), (dense[0].detach(), dense[1]))
    assert (found - expected).norm() <= 1e-4 * expected.norm()
    assert expected.norm() > 0
    return stats


@pytest.fixture(params=["numba", "torch"])
def backend(request, monkeypatch):
    if request.param == "torch":
        monkeypatch.setattr(band_ops, "kernels", None)
    else:
        assert band_ops.in_kernels(torch.zeros(1))
    return request.param


@pytest.mark.parametrize("bfloat16", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_random_networks(seed, bfloat16):
    stats = check(seed, LATTICE, bfloat16)
    assert stats.retries == 0
    assert (stats.exact_evaluations < stats.evaluations / 2) == bfloat16


@pytest.mark.parametrize("bfloat16", [False, True])
@pytest.mark.parametrize("chunk", [1, 7, 1000])
def test_chunks(monkeypatch, chunk, bfloat16, backend):
    monkeypatch.setattr(narrow_band, "CPU_CHUNK", chunk)
    check(1, SMALL_BOX if chunk == 1 else LATTICE, bfloat16)


@pytest.mark.parametrize("seed", range(4))
def test_surface_on_every_side_of_the_box(seed, backend):
    check(seed, SMALL_BOX, bfloat16=True)
    net, code, offset = network(seed)
    assert_closed(*extract_sparse(net(code), SMALL_BOX, offset, **OPTIONS)[:2])


def extract_with(monkeypatch, kernels, seed, lattice):
    net, code, offset = network(seed)
    with monkeypatch.context() as patch:
        if not kernels:
            patch.setattr(band_ops, "kernels", None)
        field = net(code)
        verts, faces, stats = extract_sparse(field, lattice, offset, **OPTIONS, approximation=field.coarse)
        return verts, faces, stats, gradients(net, code, verts)


@pytest.mark.parametrize("lattice", [LATTICE, SMALL_BOX])
@pytest.mark.parametrize("seed", range(3))
def test_backends_agree_bit_for_bit_up_to_the_order_of_faces(monkeypatch, seed, lattice):
    first = extract_with(monkeypatch, True, seed, lattice)
    second = extract_with(monkeypatch, False, seed, lattice)
    assert torch.equal(first[0], second[0])
    assert first[2] == second[2]
    assert canonical(first[0].detach(), first[1])[1] == canonical(second[0].detach(), second[1])[1]
    assert torch.equal(first[3], second[3])


def test_marks_and_lists_of_the_backends_are_equal(monkeypatch):
    net, code, offset = network(2)
    bands, marches = [], []
    for kernels in (band_ops.kernels, None):
        monkeypatch.setattr(band_ops, "kernels", kernels)
        band = NarrowBand(SignSource(net(code), None, torch.zeros(())), LATTICE, offset)
        with torch.no_grad():
            band.find_cells(0.5, 4)
            assert band.flood() > 0
        bands.append((band.known, band.inside, band.active, band.bricks.origins, band.cells()))
        marches.append(band_march.march(band))
    for first, second in zip(*bands, strict=True):
        assert torch.equal(first, second)
    assert torch.equal(marches[0].ends, marches[1].ends)
    for name in ("faces", "straddling"):
        first, second = (set(map(tuple, getattr(m, name).tolist())) for m in marches)
        assert {min(f, f[1:] + f[:1], f[2:] + f[:2]) for f in first} == {
            min(f, f[1:] + f[:1], f[2:] + f[:2]) for f in second
        }


def test_order_of_the_vertices_does_not_depend_on_bricks(backend):
    """Lower end first, then the higher one, by their numbers in the lattice."""
    net, code, offset = network(4)
    with torch.no_grad():
        band = NarrowBand(SignSource(net(code), None, torch.zeros(())), LATTICE, offset)
        band.find_cells(1.5, 4)
        ends = band_march.march(band).ends
    numbers = LATTICE.number(band.bricks.half_steps(ends.flatten())).view(-1, 2).sort(dim=1).values.tolist()
    assert numbers == sorted(numbers)
    assert len(set(map(tuple, numbers))) == len(numbers) > 100


def test_a_wrong_approximation_is_seen_and_done_without(backend):
    """Off by 0.4 everywhere but where it is calibrated."""
    net, code, offset = network(0)
    field = net(code)
    calls = []

    def misled(points):
        calls.append(len(points))
        return field(points) - (0.0 if len(calls) == 1 else 0.4)

    with torch.no_grad():
        verts, faces, stats = extract_sparse(field, LATTICE, offset, **OPTIONS, approximation=misled)
        assert stats.retries == 1
        assert_same((verts, faces), extract_dense(field, LATTICE, offset))


def test_margin_covers_the_error_of_bfloat16():
    """The margin found at 128 points of the coarsest blocks exceeds the largest error at 20,000 others."""
    points = (2 * torch.rand(20000, 3, generator=torch.Generator().manual_seed(0)) - 1) * 2.5
    for seed in range(6):
        net, code, offset = network(seed, hidden_dim=64)
        with torch.no_grad():
            field = net(code)
            source = SignSource(field, field.coarse, torch.zeros(()))
            NarrowBand(source, LATTICE, offset).find_cells(1.5, 4)
            error = (field(points) - field.coarse(points)).abs().max()
        assert 0 < 1.5 * error < source.margin < 0.25 * LATTICE.cell_size


def test_signs_are_those_of_the_exact_field():
    net, code, offset = network(3)
    with torch.no_grad():
        field = net(code)
        band = NarrowBand(SignSource(field, field.coarse, torch.zeros(())), LATTICE, offset)
        band.find_cells(1.5, 4)
        known = band.known.nonzero()[:, 0]
        steps = band.bricks.half_steps(known)
        values = LATTICE.close(steps, field(LATTICE.embed(steps, offset)))
    assert len(known) > 500
    clear = values.abs() > 1e-5
    assert torch.equal(band.inside[known][clear], (values > 0)[clear])


def test_marks_grow_with_the_surface_not_with_the_box():
    def ball(points):
        return 0.8 - points.norm(dim=1)

    sizes = []
    for half in (1.0, 4.0):
        lattice = BCCLattice(cell_size=0.1, half_extents=(half, half, half))
        band = NarrowBand(SignSource(ball, None, torch.zeros(())), lattice, torch.zeros(3))
        band.find_cells(1.5, 8)
        band.flood()
        sizes.append((len(band.known), len(band.bricks.table), lattice.num_cells + lattice.num_corners))
    assert sizes[1][0] < 2 * sizes[0][0]  # bricks cut the ball differently; the box holds 64 times as many
    assert sizes[1][0] < 0.05 * sizes[1][2]
    assert sizes[1][1] < 0.01 * sizes[1][2]
