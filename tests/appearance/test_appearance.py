import torch

from fauna.appearance.albedo import AlbedoField
from fauna.appearance.base import Appearance
from fauna.appearance.feature_field import FeatureField
from fauna.appearance.lighting import LightNetwork


def appearance(symmetric: bool = True) -> Appearance:
    torch.manual_seed(0)
    common = {"num_octaves": 3, "base_frequency": 0.8, "num_layers": 3, "hidden_dim": 16, "precision": "float32"}
    return Appearance(
        albedo_field=AlbedoField(texture_dim=5, **common),
        feature_field=FeatureField(code_dim=6, out_dim=4, symmetric=symmetric, **common),
        light_network=LightNetwork(texture_dim=5, num_layers=3, hidden_dim=16),
    )


def points(number: int = 12) -> torch.Tensor:
    return torch.randn(number, 3, generator=torch.Generator().manual_seed(0))


MIRROR = torch.tensor([-1.0, 1.0, 1.0])


def test_albedo_is_symmetric_in_range_and_follows_its_row():
    field, texture = appearance(), torch.randn(3, 5, generator=torch.Generator().manual_seed(1))
    row = torch.arange(12) % 3
    albedo = field.albedo(points(), texture, row)
    assert albedo.min() >= 0
    assert albedo.max() <= 1
    torch.testing.assert_close(field.albedo(points() * MIRROR, texture, row), albedo)
    for index in range(3):
        chosen = row == index
        alone = field.albedo(points()[chosen], texture[index : index + 1], torch.zeros(int(chosen.sum())).long())
        torch.testing.assert_close(alone, albedo[chosen])
    assert (field.albedo(points(), texture.flip(0), row) - albedo).abs().max() > 1e-3


def test_feature_field_is_symmetric_only_when_asked():
    code = torch.randn(6, generator=torch.Generator().manual_seed(1))
    for symmetric in (True, False):
        field = appearance(symmetric)
        features = field.features(points(), code)
        assert features.shape == (12, 4)
        assert features.min() >= 0
        assert features.max() <= 1
        same = torch.allclose(field.features(points() * MIRROR, code), features, atol=1e-6)
        assert same == symmetric


def test_no_pixel_is_no_problem():
    field = appearance()
    empty = field.albedo(points(0), torch.zeros(2, 5), torch.zeros(0).long())
    assert empty.shape == (0, 3)


def test_light_comes_from_above_within_its_ranges():
    light = appearance().light(100 * torch.randn(50, 5, generator=torch.Generator().manual_seed(2)))
    torch.testing.assert_close(light.direction.norm(dim=1), torch.ones(50))
    assert (light.direction[:, 1] > 0.3).all()
    assert light.ambient.min() >= 0
    assert light.ambient.max() <= 1
    assert light.diffuse.min() >= 0.5
    assert light.diffuse.max() <= 1


def test_an_undecided_light_stands_overhead():
    light = appearance().light(torch.zeros(1, 5))
    torch.testing.assert_close(light.direction, torch.tensor([[0.0, 1.0, 0.0]]))
    torch.testing.assert_close(light.ambient, torch.tensor([0.5]))
    torch.testing.assert_close(light.diffuse, torch.tensor([0.75]))


def test_gradient_reaches_texture_and_code():
    field = appearance()
    texture, code = torch.ones(1, 5, requires_grad=True), torch.ones(6, requires_grad=True)
    light = field.light(texture)
    total = field.albedo(points(), texture, torch.zeros(12).long()).sum() + field.features(points(), code).sum()
    (total + light.direction.sum() + light.ambient.sum() + light.diffuse.sum()).backward()
    assert texture.grad is not None
    assert code.grad is not None
    assert texture.grad.abs().sum() > 0
    assert code.grad.abs().sum() > 0
