"""Viewpoints, crop cameras and flips."""

import numpy as np
import pytest

from fauna.errors import FaunaError
from fauna.metrics.camera import crop_camera, front_back_flip, left_right_flip, viewpoint, wrap_degrees
from fauna.metrics.visibility import to_ndc
from tests.metrics.animals import camera


@pytest.mark.parametrize("azimuth", [-170.0, -90.0, 0.0, 30.0, 90.0, 179.0])
@pytest.mark.parametrize("elevation", [-10.0, 0.0, 40.0])
def test_viewpoint_reads_off_the_camera(azimuth, elevation):
    view, _ = camera(azimuth, elevation)
    np.testing.assert_allclose(viewpoint(view), (azimuth, elevation), atol=1e-9)
    roll = np.eye(4)
    roll[:2, :2] = [[0.8, -0.6], [0.6, 0.8]]
    np.testing.assert_allclose(viewpoint(roll @ view), (azimuth, elevation), atol=1e-9)


def test_facing_and_heading_right():
    """Azimuth 0: the head (+z) is nearer to the camera; 90: it lies to the right."""
    view, _ = camera(0.0, 0.0)
    assert (view[:3, :3] @ [0, 0, 1])[2] == pytest.approx(1)
    view, _ = camera(90.0, 0.0)
    assert (view[:3, :3] @ [0, 0, 1])[0] == pytest.approx(1)


def test_crop_camera_of_a_centred_camera_is_itself():
    view, clip = camera(40.0)
    turned, focal = crop_camera(view, clip)
    np.testing.assert_allclose(turned, view, atol=1e-12)
    assert focal == pytest.approx(1 / np.tan(np.radians(12.5)))


def test_crop_camera_looks_through_the_centre_of_the_crop():
    view, clip = camera(40.0)
    cut = np.diag([2.0, 2.0, 1.0, 1.0])
    cut[:2, 3] = 0.6, -0.4  # a crop beside the optical axis
    turned, focal = crop_camera(view, cut @ clip)
    point = np.linalg.inv(turned) @ [0, 0, -7, 1]
    np.testing.assert_allclose(to_ndc(cut @ clip, point[None, :3]), [[0, 0]], atol=1e-9)
    assert focal == pytest.approx(2 / np.tan(np.radians(12.5)), rel=0.02)
    step = np.linalg.inv(turned) @ [0.01, 0, -7, 1]
    assert to_ndc(cut @ clip, step[None, :3])[0, 0] == pytest.approx(focal * 0.01 / 7, rel=0.02)
    np.testing.assert_allclose(turned[:3, :3] @ turned[:3, :3].T, np.eye(3), atol=1e-12)


def test_a_camera_without_perspective_is_refused():
    with pytest.raises(FaunaError, match="expected a perspective camera, got one whose w is constant"):
        crop_camera(np.eye(4), np.eye(4))


def test_wrap():
    assert [wrap_degrees(a) for a in (0.0, 180.0, 190.0, -190.0, 720.0)] == [0, -180, -170, 170, 0]


@pytest.mark.parametrize(
    ("predicted", "true", "front_back", "left_right"),
    [
        (10, 10, False, False),
        (170, 10, True, False),
        (-10, 10, False, False),  # nearly frontal: left and right cannot be told
        (120, 60, True, False),
        (-60, 60, False, True),
        (-120, 60, True, True),  # half a turn
        (89, 90, False, False),
        (91, 89, False, False),  # a side view has neither front nor back
        (-90, 90, False, True),
        (80, 100, False, False),
        (0, 180, True, False),
    ],
)
def test_flips(predicted, true, front_back, left_right):
    assert front_back_flip(float(predicted), float(true)) == front_back
    assert left_right_flip(float(predicted), float(true)) == left_right
