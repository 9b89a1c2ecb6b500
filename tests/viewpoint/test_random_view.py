import math

import torch

from fauna.geometry.rotations import rotation_y
from fauna.viewpoint.random_view import random_view_rotations


def rotations(rows: int, seed: int = 0) -> torch.Tensor:
    noise = torch.randn(rows, 3, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    q, _ = torch.linalg.qr(noise)
    return q * torch.linalg.det(q)[:, None, None]


def generator(seed: int = 1) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_upright_views_look_horizontally_whatever_was_predicted():
    views = random_view_rotations(rotations(64), "upright", generator())
    up = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64).expand(64, 3)
    torch.testing.assert_close(views[:, :, 1], up)
    assert torch.equal(views, random_view_rotations(rotations(64, seed=5), "upright", generator()))


def test_predicted_views_turn_about_the_animals_own_vertical():
    predicted = rotations(64)
    views = random_view_rotations(predicted, "predicted", generator())
    torch.testing.assert_close(
        views[:, :, 1], predicted[:, :, 1]
    )  # the animal's up axis keeps its place in the picture
    turn = predicted.transpose(1, 2) @ views
    angles = torch.rand(64, generator=generator(), dtype=torch.float64) * 2 * math.pi
    torch.testing.assert_close(turn, rotation_y(angles))


def test_angles_cover_the_circle_evenly():
    views = random_view_rotations(rotations(4000), "upright", generator())
    angles = torch.atan2(views[:, 0, 2], views[:, 0, 0])
    counts = torch.histc(angles, bins=8, min=-math.pi, max=math.pi)
    assert counts.sum() == 4000
    assert (counts - 500).abs().max() < 5 * math.sqrt(500)


def test_views_are_a_function_of_the_generator_and_carry_no_gradient():
    predicted = rotations(3).requires_grad_(True)
    first, again, other = (random_view_rotations(predicted, "predicted", generator(s)) for s in (1, 1, 2))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)
    assert not first.requires_grad
