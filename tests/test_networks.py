import math

import pytest
import torch

from fauna.networks import MLP, CoordMLP, HarmonicEmbedding, modulated_weight, take_groups


def test_embedding_by_hand():
    points = torch.tensor([[0.3, -1.2, 0.7], [0.0, 2.0, -0.1]])
    embedded = HarmonicEmbedding(num_octaves=3, base_frequency=0.8)(points)
    for row, point in zip(embedded.tolist(), points.tolist(), strict=True):
        angles = [x * 0.8 * 2**j for x in point for j in range(3)]
        expected = [*point, *[math.sin(a) for a in angles], *[math.cos(a) for a in angles]]
        assert row == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("octaves", [0, 8])
def test_embedding_width(octaves):
    embedding = HarmonicEmbedding(num_octaves=octaves, base_frequency=1.0)
    assert embedding(torch.zeros(2, 5, 3)).shape == (2, 5, embedding.out_dim(3))
    assert embedding.out_dim(3) == 3 + 6 * octaves


def test_mlp_has_no_bias_and_counts_its_layers():
    mlp = MLP(in_dim=4, out_dim=2, num_layers=3, hidden_dim=8)
    assert [tuple(p.shape) for p in mlp.parameters()] == [(8, 4), (8, 8), (2, 8)]
    x = torch.randn(5, 4)
    a, b, c = (layer.weight for layer in mlp.layers)
    torch.testing.assert_close(mlp(x), ((x @ a.T).relu() @ b.T).relu() @ c.T)
    torch.testing.assert_close(mlp(2 * x), 2 * mlp(x))


def coord_mlp(condition_dim, num_layers=3, precision="float32"):
    torch.manual_seed(0)
    return CoordMLP(
        num_octaves=2,
        base_frequency=0.8,
        condition_dim=condition_dim,
        out_dim=3,
        num_layers=num_layers,
        hidden_dim=16,
        precision=precision,
    ).double()


@pytest.mark.parametrize("num_layers", [1, 3])
def test_split_first_layer_equals_concatenation(num_layers):
    field = coord_mlp(6, num_layers)
    points, condition = torch.randn(9, 3).double(), torch.randn(4, 6).double()
    group = torch.tensor([0, 3, 3, 1, 2, 0, 1, 1, 3])
    hidden = torch.cat((field.in_layer(field.embedding(points)), condition[group]), dim=1).relu()
    torch.testing.assert_close(field(points, condition, group), field.mlp(hidden))


def test_grid_is_the_field_of_every_condition_at_the_same_points():
    field = coord_mlp(6)
    points, condition = torch.randn(9, 3).double(), torch.randn(4, 6).double()
    expected = [field(points, row[None]) for row in condition]
    torch.testing.assert_close(field.grid(points, condition), torch.stack(expected))


def test_take_groups_is_indexing_and_so_is_its_gradient():
    values = torch.randn(4, 6).double().requires_grad_()
    group = torch.tensor([0, 3, 3, 1, 2, 0, 1, 1, 3])
    assert torch.equal(take_groups(values, group), values[group])
    assert torch.autograd.gradcheck(lambda v: take_groups(v, group), values)


def test_reduced_precision_changes_little_and_keeps_types():
    exact, reduced = coord_mlp(6).float(), coord_mlp(6, precision="bfloat16").float()
    points, condition = torch.randn(200, 3), torch.randn(4, 6)
    group = torch.arange(200) % 4
    expected, found = exact(points, condition, group), reduced(points, condition, group)
    assert found.dtype == torch.float32
    error = ((found - expected).norm() / expected.norm()).item()
    assert 1e-5 < error < 2e-2  # it is reduced, but not by more than eight bits of mantissa explain
    found.sum().backward()
    assert all(parameter.grad.dtype == torch.float32 for parameter in reduced.parameters())


def test_single_condition_needs_no_group():
    field = coord_mlp(6)
    points, condition = torch.randn(9, 3).double(), torch.randn(1, 6).double()
    torch.testing.assert_close(field(points, condition), field(points, condition, torch.zeros(9, dtype=torch.long)))


def test_conditions_of_other_groups_get_no_gradient():
    field = coord_mlp(6)
    condition = torch.randn(3, 6).double().requires_grad_()
    field(torch.randn(5, 3).double(), condition, torch.tensor([0, 2, 2, 0, 0])).sum().backward()
    assert condition.grad[1].abs().max() == 0
    assert condition.grad[[0, 2]].abs().amax(dim=1).min() > 0


def test_gradcheck():
    field = coord_mlp(2)
    group = torch.tensor([0, 1, 1])
    points = torch.randn(3, 3).double().requires_grad_()
    condition = torch.randn(2, 2).double().requires_grad_()
    assert torch.autograd.gradcheck(lambda p, c: field(p, c, group), (points, condition))


def test_unconditioned_and_wrong_use():
    assert coord_mlp(0)(torch.randn(4, 3).double()).shape == (4, 3)
    with pytest.raises(ValueError, match="condition_dim"):
        coord_mlp(0)(torch.randn(4, 3).double(), torch.randn(1, 6).double())
    with pytest.raises(ValueError, match="condition_dim"):
        coord_mlp(6)(torch.randn(4, 3).double())
    with pytest.raises(ValueError, match="group"):
        coord_mlp(6)(torch.randn(4, 3).double(), torch.randn(2, 6).double())


@pytest.mark.parametrize("size", [1.0, 1e-3])
def test_demodulated_row_norm(size):
    weight, style = torch.randn(5, 7).double(), size * torch.randn(7).double()
    squares = (weight * style).square().sum(dim=1)
    result = modulated_weight(weight, style, 1e-5)
    torch.testing.assert_close(result.norm(dim=1), (squares / (squares + 1e-5)).sqrt())
    torch.testing.assert_close(result / result.norm(dim=1, keepdim=True), weight * style / squares.sqrt()[:, None])


def test_style_scale_only_matters_when_small():
    weight, style = torch.randn(5, 7).double(), 1 + torch.rand(7).double()
    normal, large, small = (modulated_weight(weight, scale * style, 1e-5) for scale in (1.0, 100.0, 1e-4))
    torch.testing.assert_close(normal, large, rtol=1e-4, atol=0)
    assert (small.abs() < 0.2 * normal.abs()).all()
