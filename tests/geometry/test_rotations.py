import math

import pytest
import torch
from torch.autograd import gradcheck

from fauna.geometry.rotations import azimuth_elevation, euler_xyz_to_matrix, look_at_rotation, rotation_y


def axis_rotation(axis: int, angle: float) -> torch.Tensor:
    """Rotation about one axis as a matrix exponential of the cross-product matrix."""
    e = torch.eye(3, dtype=torch.float64)[axis]
    skew = torch.stack([torch.linalg.cross(e, column) for column in torch.eye(3, dtype=torch.float64)], dim=1)
    return torch.matrix_exp(angle * skew)


def assert_rotation(matrix: torch.Tensor) -> None:
    eye = torch.eye(3, dtype=matrix.dtype).expand_as(matrix)
    torch.testing.assert_close(matrix @ matrix.transpose(-1, -2), eye)
    torch.testing.assert_close(torch.linalg.det(matrix), torch.ones(matrix.shape[:-2], dtype=matrix.dtype))


def test_euler_is_the_product_of_three_axis_rotations():
    generator = torch.Generator().manual_seed(0)
    angles = 6 * torch.rand(5, 2, 3, generator=generator, dtype=torch.float64) - 3
    matrices = euler_xyz_to_matrix(angles)
    for angle, matrix in zip(angles.reshape(-1, 3), matrices.reshape(-1, 3, 3), strict=True):
        expected = axis_rotation(0, angle[0]) @ axis_rotation(1, angle[1]) @ axis_rotation(2, angle[2])
        torch.testing.assert_close(matrix, expected)


def test_swing_moves_forward_in_the_sagittal_plane():
    quarter = euler_xyz_to_matrix(torch.tensor([math.pi / 2, 0.0, 0.0]))
    torch.testing.assert_close(quarter @ torch.tensor([0.0, 1.0, 0.0]), torch.tensor([0.0, 0.0, 1.0]))


def test_rotation_y_turns_forward_to_the_right():
    turn = rotation_y(torch.tensor([math.pi / 2], dtype=torch.float64))
    torch.testing.assert_close(turn[0], axis_rotation(1, math.pi / 2))
    torch.testing.assert_close(turn[0, :, 2], torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64))


def test_look_at_has_no_roll_and_keeps_the_direction():
    generator = torch.Generator().manual_seed(1)
    forward = torch.randn(50, 3, generator=generator, dtype=torch.float64)
    matrix = look_at_rotation(forward)
    assert_rotation(matrix)
    torch.testing.assert_close(matrix[:, :, 2], torch.nn.functional.normalize(forward, dim=-1))
    torch.testing.assert_close(matrix[:, 1, 0], torch.zeros(50, dtype=torch.float64))
    assert (matrix[:, 1, 1] >= 0).all()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_look_at_is_a_rotation_with_finite_gradient_when_forward_is_vertical(sign):
    forward = torch.tensor([[0.0, sign, 0.0]], requires_grad=True)
    matrix = look_at_rotation(forward)
    assert_rotation(matrix.detach())
    (matrix * torch.arange(9.0).reshape(3, 3)).sum().backward()
    assert forward.grad is not None
    assert torch.isfinite(forward.grad).all()


def test_azimuth_and_elevation_invert_the_construction():
    azimuth = torch.linspace(-3.0, 3.0, 13, dtype=torch.float64)
    torch.testing.assert_close(azimuth_elevation(rotation_y(azimuth))[0], azimuth)
    elevation = torch.linspace(-1.4, 1.4, 13, dtype=torch.float64)
    forward = torch.stack((elevation.cos() * azimuth.sin(), elevation.sin(), elevation.cos() * azimuth.cos()), dim=-1)
    found = azimuth_elevation(look_at_rotation(forward))
    torch.testing.assert_close(found, (azimuth, elevation))


def test_gradients():
    generator = torch.Generator().manual_seed(2)
    points = torch.randn(3, 3, generator=generator, dtype=torch.float64, requires_grad=True)
    assert gradcheck(euler_xyz_to_matrix, (points,))
    assert gradcheck(look_at_rotation, (points,))
