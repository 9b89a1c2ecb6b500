"""The prior against written-out distances and automatic differentiation."""

import math

import pytest
import torch

from fauna.errors import FaunaError
from fauna.shape.prior import Legs, Prior

LEGS = Legs(x=0.3, z=1.0, hip=0.1, foot=-0.95, radius=0.18, blend=0.05)
RADII = torch.tensor([0.6, 0.7, 1.8], dtype=torch.float64)


def points(count: int = 200) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    return (torch.rand(count, 3, generator=generator, dtype=torch.float64) - 0.5) * torch.tensor([2.0, 3.0, 5.0])


def slow(point: list[float], lift: float, legs: Legs | None) -> float:
    """One point at a time."""
    x, y, z = point
    smallest = min(RADII.tolist())
    scaled = [(value * smallest / radius) ** 2 for value, radius in zip((x, y - lift, z), RADII.tolist(), strict=True)]
    parts = [smallest - math.sqrt(sum(scaled))]
    if legs is None:
        return parts[0]
    for side in (-1, 1):
        for end in (-1, 1):
            axis = [
                (side * legs.x, legs.foot + share * (legs.hip - legs.foot) / 2000, end * legs.z)
                for share in range(2001)
            ]
            parts.append(legs.radius - min(math.dist(point, place) for place in axis))
    return legs.blend * math.log(sum(math.exp(part / legs.blend) for part in parts))


@pytest.mark.parametrize("legs", [None, LEGS])
@pytest.mark.parametrize("lift", [0.0, 0.2])
def test_distances_are_those_written_out(legs, lift):
    sampled = points(30)
    expected = torch.tensor([slow(point, lift, legs) for point in sampled.tolist()], dtype=torch.float64)
    torch.testing.assert_close(Prior(RADII, lift, legs)(sampled), expected, atol=1e-6, rtol=0)


@pytest.mark.parametrize("legs", [None, LEGS])
def test_the_gradient_is_that_of_automatic_differentiation(legs):
    prior, sampled = Prior(RADII, 0.2, legs), points().requires_grad_()
    (expected,) = torch.autograd.grad(prior(sampled).sum(), sampled)
    torch.testing.assert_close(prior.gradient(sampled.detach()), expected, atol=1e-9, rtol=1e-9)
    assert expected.norm(dim=1).max() <= 1 + 1e-9  # the extraction's Lipschitz bound covers it


def test_it_is_symmetric_and_its_legs_are_apart():
    prior, sampled = Prior(RADII, 0.2, LEGS), points()
    for axis in (0, 2):
        mirrored = sampled.clone()
        mirrored[:, axis] *= -1
        torch.testing.assert_close(prior(mirrored), prior(sampled))
    feet = torch.tensor([[x, -0.9, z] for x in (-0.3, 0.3) for z in (-1.0, 1.0)], dtype=torch.float64)
    between = torch.tensor([[0.0, -0.9, 1.0], [0.0, -0.9, -1.0], [0.3, -0.9, 0.0]], dtype=torch.float64)
    assert (prior(feet) > 0).all()
    assert (prior(between) < 0).all()


def test_impossible_legs_are_refused():
    with pytest.raises(FaunaError, match="foot below hip"):
        Legs(x=0.3, z=1.0, hip=-1.0, foot=-0.95, radius=0.18, blend=0.05)
