import pytest
import torch

from fauna.errors import FaunaError
from fauna.shape.sdf_mesh import SDFMesh
from fauna.shape.sdf_mlp import SDFNetwork


def shape(residual_scale=0.3, **options):
    torch.manual_seed(0)
    sdf = SDFNetwork(
        embedding_dim=16,
        num_octaves=6,
        base_frequency=0.8,
        hidden_dim=32,
        num_layers=4,
        ellipsoid_radii=(0.95, 0.95, 1.9),
        ellipsoid_lift=0.0,
        legs=None,
        residual_scale=residual_scale,
        style_offset=1.0,
        demodulation_eps=1e-5,
    )
    values = {
        "grid_resolution": 64,
        "grid_scale": 5.0,
        "half_extents": (1.35, 2.3, 2.4),
        "jitter": 0.5,
        "lipschitz": 1.5,
        "coarse_cells": 8,
        "coarse_bf16": False,
        "min_component_fraction": 0.0,
        "eikonal_points": 200,
        "eikonal_spread": 0.35,
    }
    return SDFMesh(sdf=sdf, **{**values, **options})


def generator(seed):
    return torch.Generator().manual_seed(seed)


CODE = torch.randn(16, generator=generator(1))


def test_without_generator_there_is_no_jitter():
    first, second = shape()(CODE, None), shape(jitter=0.0)(CODE, generator(0))
    assert torch.equal(first.verts, second.verts)
    assert torch.equal(first.faces, second.faces)


def test_jitter_moves_the_lattice_but_not_the_mirror_plane():
    model = shape()
    first, second = model(CODE, generator(0)), model(CODE, generator(1))
    assert not torch.equal(first.verts[:10], second.verts[:10])
    for base in (first, second):
        verts = base.verts.detach()
        flipped = verts * torch.tensor([-1.0, 1.0, 1.0])
        assert sorted(flipped.tolist()) == sorted(verts.tolist())


def test_same_draws_same_mesh_and_gradients():
    torch.use_deterministic_algorithms(True)
    try:
        results = []
        for _ in range(2):
            model = shape()
            base = model(CODE, generator(5))
            loss = base.verts.square().mean() + model.eikonal(CODE, base, generator(6))
            results.append([loss, *torch.autograd.grad(loss, list(model.parameters()))])
    finally:
        torch.use_deterministic_algorithms(False)
    for first, second in zip(*results, strict=True):
        assert torch.equal(first, second)


def test_mesh_reaches_code_and_all_weights():
    model, code = shape(), CODE.clone().requires_grad_()
    model(code, None).verts.square().mean().backward()
    assert code.grad.abs().max() > 0
    assert all(p.grad is not None and p.grad.abs().max() > 0 for p in model.parameters())


def test_eikonal_is_exact_for_the_sphere_and_ignores_the_code():
    model = shape(residual_scale=0.0)
    model.sdf.radii.fill_(1.0)
    base = model(CODE, None)
    assert model.eikonal(CODE, base, generator(0)).item() == pytest.approx(0.0, abs=1e-10)
    model, code = shape(), CODE.clone().requires_grad_()
    base = model(code, None)
    loss = model.eikonal(code, base, generator(0))
    loss.backward()
    assert code.grad is None
    assert model.sdf.in_layer.weight.grad.abs().max() > 0


def test_eikonal_against_autograd_at_its_own_points(monkeypatch):
    model = shape()
    seen = []
    field = model.sdf(CODE)
    original = type(field).gradient
    monkeypatch.setattr(type(field), "gradient", lambda self, points: (seen.append(points), original(self, points))[1])
    base = model(CODE, None)
    loss = model.eikonal(CODE, base, generator(0))
    points = seen[0].requires_grad_()
    assert points.shape == (400, 3)
    box = torch.tensor(model.lattice.box)
    assert (points[:200].abs() <= box).all()
    assert (points[:200].abs().amax(dim=0) > 0.9 * box).all()
    distance = torch.cdist(points[200:], base.verts, p=float("inf")).amin(dim=1)
    assert 0.25 < distance.max() <= 0.35 + 1e-5
    (gradient,) = torch.autograd.grad(field(points).sum(), points)
    assert loss.item() == pytest.approx((gradient.norm(dim=1) - 1).square().mean().item(), rel=1e-4)


def test_resolution_schedule():
    model = shape(half_extents=None, grid_scale=4.0, grid_resolution=32)
    coarse, stats = model.extract(CODE, None)
    model.set_resolution(64)
    assert model.grid_resolution == 64
    fine, fine_stats = model.extract(CODE, None)
    assert 3 < len(fine.verts) / len(coarse.verts) < 5.5
    assert fine_stats.evaluations > stats.evaluations
    assert "grid_resolution" not in model.state_dict()


def test_wrong_numbers_are_refused():
    with pytest.raises(FaunaError, match="grid_resolution 4"):
        shape(grid_resolution=4)
    with pytest.raises(FaunaError, match="min_component_fraction"):
        shape(min_component_fraction=5.0)


def test_audit_counts_missed_islands(monkeypatch):
    model = shape(residual_scale=0.0)
    assert model.audit(CODE, None) == 0
    island = torch.tensor([[0.0, 1.6, 0.0]])

    def steep(self, points):
        return torch.maximum(0.9 - points.norm(dim=1), 4 * (0.25 - (points - island).norm(dim=1)))

    monkeypatch.setattr(type(model.sdf(CODE)), "__call__", steep)
    assert model.audit(CODE, None) == 0
    model.lipschitz, model.coarse_cells = 0.3, 4
    assert model.audit(CODE, None) == 1
    assert len(model(CODE, None).verts) > 0


def test_small_components_go(monkeypatch):
    model = shape(min_component_fraction=0.2)

    def islands(self, points):
        small = 0.25 - (points - torch.tensor([0.0, 1.6, 0.0])).norm(dim=1)
        return torch.maximum(0.9 - points.norm(dim=1), small)

    monkeypatch.setattr(type(model.sdf(CODE)), "__call__", islands)
    assert model(CODE, None).verts[:, 1].max() < 1.0
    model.min_component_fraction = 0.0
    assert model(CODE, None).verts[:, 1].max() > 1.5


def test_bfloat16_option_keeps_the_mesh():
    plain, fast = shape()(CODE, None), shape(coarse_bf16=True)(CODE, None)
    assert torch.equal(plain.verts, fast.verts)
    assert torch.equal(plain.faces, fast.faces)
