import pytest
import torch

from fauna.networks import modulated_weight
from fauna.shape.sdf_mlp import SDFNetwork

PAPER = {
    "style_offset": 0.0,
    "residual_scale": 1.0,
    "demodulation_eps": 1e-5,
    "ellipsoid_radii": (1.05, 1.05, 2.1),
    "ellipsoid_lift": 0.0,
    "legs": None,
}


def network(hidden_dim=24, num_layers=5, embedding_dim=16, num_octaves=8, **options):
    torch.manual_seed(0)
    return SDFNetwork(
        embedding_dim=embedding_dim,
        num_octaves=num_octaves,
        base_frequency=0.80784,
        hidden_dim=hidden_dim,
        num_layers=num_layers,
        **{**PAPER, **options},
    )


def test_paper_parameter_count():
    paper = network(hidden_dim=256, embedding_dim=128)
    assert sum(p.numel() for p in paper.parameters()) == 374_016


def test_zero_level_of_the_prior():
    field = network()(torch.zeros(16))
    tips = torch.tensor([[1.05, 0.0, 0.0], [0.0, -1.05, 0.0], [0.0, 0.0, 2.1]])
    torch.testing.assert_close(field(tips), torch.zeros(3), atol=1e-6, rtol=0)
    assert field(torch.zeros(1, 3)).item() == pytest.approx(1.05)
    points = torch.randn(50, 3)
    torch.testing.assert_close(field(points), 1.05 - (points * torch.tensor([1.0, 1.0, 0.5])).norm(dim=1))


def test_residual_is_small_for_a_bank_at_initialisation():
    """With codes of rms 0.011 the squared row norms are near 2.3e-6, so that eps mutes the network to about 1e-3."""
    paper, code = network(hidden_dim=256, embedding_dim=128), 0.011 * torch.randn(128)
    squares = (paper.modulated.layers[0].weight * paper.style(code)).square().sum(dim=1).mean().item()
    assert squares == pytest.approx(2.3e-6, rel=0.5)
    residual = paper(code).residual(7 * torch.rand(2000, 3) - 3.5).detach()
    assert 1e-4 < residual.std() < 2e-3
    assert residual.abs().max() < 1e-2


def test_style_offset_lets_the_network_speak():
    points, code = torch.randn(100, 3), 0.011 * torch.randn(16)
    quiet = network()(code).residual(points).detach()
    loud = network(style_offset=1.0)(code).residual(points).detach()
    assert loud.std() > 10 * quiet.std()


def test_value_against_explicit_layers():
    sdf = network(style_offset=0.5, residual_scale=0.3, num_layers=3).double()
    code, points = torch.randn(16).double(), torch.randn(20, 3).double()
    style = sdf.style.layers[1].weight @ (sdf.style.layers[0].weight @ code).relu() + 0.5
    folded = points * torch.where(points[:, :1] < 0, torch.tensor([[-1.0, 1.0, 1.0]]), torch.ones(1, 3))
    hidden = sdf.in_layer(sdf.embedding(folded))
    for layer in sdf.modulated.layers:
        hidden = hidden.relu() @ modulated_weight(layer.weight, style, 1e-5).T
    prior = 1.05 - (points * torch.tensor([1.0, 1.0, 0.5])).norm(dim=1)
    torch.testing.assert_close(sdf(code)(points), prior + 0.3 * hidden[:, 0])


def test_mirror_symmetric():
    field = network(style_offset=1.0)(torch.randn(16))
    points = torch.randn(64, 3)
    assert torch.equal(field(points), field(points * torch.tensor([-1.0, 1.0, 1.0])))


@pytest.mark.parametrize("radii", [(1.05, 1.05, 2.1), (0.7, 1.0, 1.6)])
def test_gradient_equals_autograd(radii):
    field = network(style_offset=1.0, ellipsoid_radii=radii).double()(torch.randn(16).double())
    points = torch.randn(64, 3).double().requires_grad_()
    (expected,) = torch.autograd.grad(field(points).sum(), points)
    torch.testing.assert_close(field.gradient(points.detach()), expected)


def test_parameter_gradient_of_the_gradient_equals_double_backward():
    sdf = network(style_offset=1.0).double()
    field = sdf(torch.randn(16).double())
    points = torch.randn(64, 3).double().requires_grad_()
    (by_autograd,) = torch.autograd.grad(field(points).sum(), points, create_graph=True)
    parameters = [sdf.in_layer.weight, *sdf.modulated.parameters(), *sdf.style.parameters()]
    results = []
    for gradient in (by_autograd, field.gradient(points.detach())):
        loss = (gradient.norm(dim=1) - 1).square().mean()
        results.append(torch.autograd.grad(loss, parameters, retain_graph=True))
    for expected, got in zip(*results, strict=True):
        assert expected.abs().max() > 0
        torch.testing.assert_close(got, expected)


def test_gradcheck_in_the_code():
    sdf = network(style_offset=1.0, hidden_dim=8, num_layers=3).double()
    points = torch.randn(5, 3).double()
    code = torch.randn(16).double().requires_grad_()
    assert torch.autograd.gradcheck(lambda c: sdf(c)(points), (code,))
    assert torch.autograd.gradcheck(lambda c: sdf(c).gradient(points), (code,))


def test_bfloat16_stays_within_the_margin():
    field = network(style_offset=1.0, hidden_dim=64)(torch.randn(16))
    points = 4 * torch.rand(4000, 3) - 2
    with torch.no_grad():
        error = (field.coarse(points) - field(points)).abs().max()
        assert field.residual(points).abs().max() > 0.05
    assert 0 < error < 0.02
