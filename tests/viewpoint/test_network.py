import torch

from fauna.encoder.embedder import TrunkOptions
from fauna.geometry.rotations import azimuth_elevation, look_at_rotation
from fauna.types import Features
from fauna.viewpoint.network import QUADRANTS, ViewpointNetwork

TRUNK = TrunkOptions(variant="light", hidden_dim=8, channels_per_group=4, reduce_dim=6)


def network(scale: float = 1.0) -> ViewpointNetwork:
    torch.manual_seed(0)
    net = ViewpointNetwork(key_dim=5, trunk=TRUNK, max_translation_xy=0.4, max_translation_z=1.0)
    with torch.no_grad():
        for parameter in net.trunk.layers[-1].parameters():
            parameter.mul_(scale)
    return net


def features(batch: int = 3) -> Features:
    maps = torch.randn(batch, 5, 16, 16, generator=torch.Generator().manual_seed(0))
    return Features(torch.zeros(batch, 3), maps, maps)


def test_hypotheses_stay_in_their_quadrants_and_are_rotations():
    hypotheses = network(30.0)(features(), temperature=1.0, elevation=True)
    forward = hypotheses.rotations[..., 2]
    signs = torch.tensor(QUADRANTS)[:, [0, 2]]
    assert (forward[..., [0, 2]] * signs >= 0).all()
    assert forward[..., 1].abs().max() > 0.1
    eye = torch.eye(3).expand(3, 4, 3, 3)
    torch.testing.assert_close(hypotheses.rotations @ hypotheses.rotations.mT, eye, atol=1e-5, rtol=0)


def test_an_undecided_network_looks_along_the_diagonals():
    hypotheses = network(0.0)(features(), temperature=1.0, elevation=False)
    diagonal = torch.tensor(QUADRANTS) * torch.tensor([0.5, 0.0, 0.5])
    torch.testing.assert_close(hypotheses.rotations[0], look_at_rotation(diagonal))
    torch.testing.assert_close(hypotheses.probabilities, torch.full((3, 4), 0.25))
    assert torch.equal(hypotheses.translation, torch.zeros(3, 3))


def test_without_elevation_the_animal_stays_upright():
    hypotheses = network(30.0)(features(), temperature=1.0, elevation=False)
    _, elevation = azimuth_elevation(hypotheses.rotations)
    assert torch.equal(elevation, torch.zeros(3, 4))
    torch.testing.assert_close(hypotheses.rotations[..., 1, 1], torch.ones(3, 4))


def test_lower_predicted_losses_are_more_probable_and_cold_is_sharp():
    warm = network(3.0)(features(), temperature=1.0, elevation=True)
    cold = network(3.0)(features(), temperature=0.01, elevation=True)
    assert torch.equal(warm.probabilities.argmax(1), warm.predicted_losses.argmin(1))
    torch.testing.assert_close(warm.probabilities, torch.softmax(-warm.predicted_losses, dim=1))
    assert (cold.probabilities.max(1).values > warm.probabilities.max(1).values).all()


def test_translation_is_bounded_per_axis():
    translation = network(1e4)(features(), temperature=1.0, elevation=True).translation
    torch.testing.assert_close(translation.abs(), torch.tensor([0.4, 0.4, 1.0]).expand(3, 3))


def test_every_output_reaches_the_weights():
    net = network()
    hypotheses = net(features(), temperature=1.0, elevation=True)
    weights = torch.arange(9.0).reshape(3, 3)
    total = (hypotheses.rotations * weights).sum() + hypotheses.translation.sum() + hypotheses.predicted_losses.sum()
    total.backward()
    grad = net.trunk.layers[-1].weight.grad
    assert grad is not None
    assert (grad.abs().sum(1) > 0).all()
