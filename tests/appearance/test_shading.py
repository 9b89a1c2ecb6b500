import math

import torch
from torch.autograd import gradcheck

from fauna.appearance.shading import shade, shading_normal
from fauna.types import Light

UP = Light(torch.tensor([[0.0, 1.0, 0.0]]), torch.tensor([0.2]), torch.tensor([0.7]))


def tilted(degrees: float) -> torch.Tensor:
    """Unit vector in the y-z plane, 0 = towards the camera, 90 = up."""
    angle = math.radians(degrees)
    return torch.tensor([[0.0, math.sin(angle), math.cos(angle)]])


def grey(normal: torch.Tensor, flat: torch.Tensor | None = None) -> float:
    flat = normal if flat is None else flat
    row = torch.zeros(1).long()
    return float(shade(torch.ones(1, 3), normal, flat, torch.tensor([[0.0, 0.0, 3.0]]), UP, row)[0, 0])


def test_lambert_under_light_from_above():
    for degrees in (10.0, 45.0, 80.0):
        expected = 0.2 + 0.7 * math.sin(math.radians(degrees))
        torch.testing.assert_close(grey(tilted(degrees)), expected, atol=1e-6, rtol=0)
    torch.testing.assert_close(grey(tilted(-45.0)), 0.2, atol=1e-6, rtol=0)


def test_both_sides_of_a_face_look_the_same():
    torch.testing.assert_close(grey(-tilted(30.0)), grey(tilted(30.0)))


def test_length_of_normals_does_not_matter():
    torch.testing.assert_close(grey(5 * tilted(30.0)), grey(tilted(30.0)))


def test_a_smooth_normal_that_looks_away_yields_to_the_flat_one():
    flat = tilted(80.0)
    torch.testing.assert_close(
        shading_normal(tilted(100.0), flat, torch.tensor([[0.0, 0.0, 1.0]])), flat, atol=1e-6, rtol=0
    )
    smooth = tilted(60.0)
    torch.testing.assert_close(shading_normal(smooth, flat, torch.tensor([[0.0, 0.0, 1.0]])), smooth)


def test_each_pixel_takes_the_light_of_its_row():
    light = Light(torch.tensor([[0.0, 1.0, 0.0]] * 2), torch.tensor([0.0, 1.0]), torch.tensor([0.5, 0.5]))
    albedo = torch.tensor([[0.2, 0.4, 0.6]]).expand(3, -1)
    front = torch.tensor([[0.0, 0.0, 1.0]]).expand(3, -1)
    shaded = shade(albedo, front, front, front, light, torch.tensor([1, 0, 1]))
    torch.testing.assert_close(shaded, albedo * torch.tensor([[1.0], [0.0], [1.0]]))


def test_gradients():
    generator = torch.Generator().manual_seed(0)
    normal, flat, view = torch.randn(3, 4, 3, generator=generator, dtype=torch.float64).unbind(0)
    inputs = tuple(part.requires_grad_() for part in (normal, flat, view))
    assert gradcheck(shading_normal, inputs)
