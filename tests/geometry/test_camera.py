import math

import pytest
import torch

from fauna.geometry.camera import FAR, NEAR, clip_from_camera, make_camera, project, to_clip
from fauna.geometry.rotations import rotation_y


def nominal(rows: int = 1):
    return make_camera(torch.eye(3).expand(rows, 3, 3), torch.zeros(rows, 3), fov_deg=25.0, distance=10.0)


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0)),
        ((1.0, 0.0, 0.0), (1 / 2.2169, 0.0)),
        ((0.0, 1.0, 0.0), (0.0, -1 / 2.2169)),
        ((-2.2169, 2.2169, 0.0), (-1.0, -1.0)),
    ],
)
def test_world_axes_on_the_image(point, expected):
    ndc = project(torch.tensor(point).reshape(1, 1, 3), nominal())[0, 0]
    torch.testing.assert_close(ndc, torch.tensor(expected), atol=5e-5, rtol=0)


def test_closer_points_are_magnified():
    ndc = project(torch.tensor([[[1.0, 0.0, 0.0], [1.0, 0.0, 5.0]]]), nominal())[0, :, 0]
    torch.testing.assert_close(ndc[1], 2 * ndc[0])


def test_near_and_far_planes_have_depth_minus_and_plus_one():
    clip = (
        clip_from_camera(25.0, NEAR, FAR).double()
        @ torch.tensor([[0.0, 0.0, -NEAR, 1.0], [0.0, 0.0, -FAR, 1.0]], dtype=torch.float64).T
    )
    torch.testing.assert_close(clip[2] / clip[3], torch.tensor([-1.0, 1.0], dtype=torch.float64), atol=1e-5, rtol=0)


def test_camera_is_rotation_then_translation_then_distance():
    rotation = rotation_y(torch.tensor([0.3, -2.0]))
    translation = torch.tensor([[0.1, -0.2, 0.5], [0.0, 0.3, -1.0]])
    camera = make_camera(rotation, translation, fov_deg=25.0, distance=10.0)
    point = torch.tensor([0.4, 0.7, -1.1])
    focal = 1 / math.tan(math.radians(12.5))
    for row in range(2):
        seen = rotation[row] @ point + translation[row] - torch.tensor([0.0, 0.0, 10.0])
        expected = torch.stack((focal * seen[0] / -seen[2], -focal * seen[1] / -seen[2]))
        torch.testing.assert_close(project(point.reshape(1, 1, 3), camera)[row, 0], expected)
    torch.testing.assert_close(camera.camera_from_world[:, 3], torch.tensor([[0.0, 0.0, 0.0, 1.0]] * 2))


def test_shared_points_equal_repeated_points():
    camera = make_camera(rotation_y(torch.tensor([0.3, 1.0])), torch.zeros(2, 3), fov_deg=25.0, distance=10.0)
    points = torch.randn(1, 7, 3, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(
        to_clip(points, camera.clip_from_world), to_clip(points.expand(2, -1, -1), camera.clip_from_world)
    )


def test_points_behind_the_camera_stay_finite():
    points = torch.tensor([[[0.3, 0.2, 10.0], [0.3, 0.2, 12.0]]], requires_grad=True)
    ndc = project(points, nominal())
    ndc.sum().backward()
    assert points.grad is not None
    assert torch.isfinite(ndc).all()
    assert torch.isfinite(points.grad).all()


def test_translation_and_rotation_receive_gradient():
    translation = torch.zeros(1, 3, requires_grad=True)
    angle = torch.zeros(1, requires_grad=True)
    camera = make_camera(rotation_y(angle), translation, fov_deg=25.0, distance=10.0)
    project(torch.tensor([[[0.0, 0.0, 1.0]]]), camera)[..., 0].sum().backward()
    assert translation.grad is not None
    assert angle.grad is not None
    assert translation.grad[0, 0] > 0
    assert angle.grad[0] > 0
