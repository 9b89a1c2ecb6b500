"""Camera alignment forgives scale with depth and nothing else; Procrustes and closest points undo similarities."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fauna.metrics.alignment import align_camera, align_similarity, pa_mpjpe, procrustes
from fauna.metrics.novel_view import novel_view_iou, view_rotations
from fauna.metrics.surface import distances, surface_points
from tests.metrics.animals import animal, camera


def scaled(prediction, factor):
    """The same picture of an animal ``factor`` times as large and far."""
    view = prediction.camera_from_world.copy()
    clip_from_camera = prediction.clip_from_world @ np.linalg.inv(view)
    view[:3, 3] *= factor
    return replace(
        prediction, verts=prediction.verts * factor, camera_from_world=view, clip_from_world=clip_from_camera @ view
    )


def off(aligned):
    return distances(aligned.predicted.verts, aligned.true).max() / aligned.size


@pytest.mark.parametrize("factor", [0.2, 1.0, 7.0])
def test_scale_with_depth_is_forgiven(factor):
    prediction, sample = animal("a")
    aligned = align_camera(scaled(prediction, factor), sample.truth)
    assert off(aligned) < 1e-9
    assert novel_view_iou(aligned) == 1


def test_another_focal_length_costs_perspective_only():
    prediction, sample = animal("a")
    view, clip = camera(70.0, distance=30.0, focal=3 / np.tan(np.radians(12.5)))
    aligned = align_camera(replace(prediction, camera_from_world=view, clip_from_world=clip), sample.truth)
    assert 0 < off(aligned) < 0.02


@pytest.mark.parametrize("shift", [(0.3, 0.0), (0.0, -0.3)])
def test_a_shift_in_the_image_remains_an_error(shift):
    _, sample = animal("a")
    moved, _ = animal("a", shift=shift)
    aligned = align_camera(moved, sample.truth)
    difference = aligned.predicted.verts - aligned.true.verts
    np.testing.assert_allclose(difference, np.broadcast_to([*shift, 0.0], difference.shape), atol=1e-9)


def test_too_large_in_the_image_remains_an_error():
    prediction, sample = animal("a")
    aligned = align_camera(replace(prediction, verts=prediction.verts * 1.3), sample.truth)
    ratio = np.ptp(aligned.predicted.verts, axis=0) / np.ptp(aligned.true.verts, axis=0)
    np.testing.assert_allclose(ratio, 1.3, rtol=0.05)


def test_similarity_undoes_rotation_and_scale():
    prediction, sample = animal("a", angles=(0.4, 0.0, -0.2, 0.1))
    turn = Rotation.from_euler("xyz", (0.15, 0.2, -0.1)).as_matrix()
    aligned = align_camera(replace(prediction, verts=1.2 * prediction.verts @ turn.T), sample.truth)
    points = [surface_points(m, count=400, rng=np.random.default_rng(0)) for m in (aligned.predicted, aligned.true)]
    fitted = align_similarity(aligned, *points)
    assert off(aligned) > 0.04
    assert off(fitted) < 0.015


def test_similarity_undoes_a_half_turn():
    prediction, sample = animal("a", azimuth_deg=80.0)
    view, clip = camera(-100.0)
    aligned = align_camera(replace(prediction, camera_from_world=view, clip_from_world=clip), sample.truth)
    points = [surface_points(m, count=400, rng=np.random.default_rng(0)) for m in (aligned.predicted, aligned.true)]
    assert off(align_similarity(aligned, *points)) < 0.02


def test_procrustes_recovers_a_similarity_and_never_mirrors():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(12, 3))
    rotation = Rotation.from_rotvec([0.3, -2.0, 0.7]).as_matrix()
    goal = 2.5 * points @ rotation.T + [1, 2, 3]
    scale, found, shift = procrustes(points, goal)
    assert scale == pytest.approx(2.5)
    np.testing.assert_allclose(found, rotation, atol=1e-12)
    np.testing.assert_allclose(shift, [1, 2, 3], atol=1e-12)
    assert pa_mpjpe(points, goal) < 1e-12
    mirrored = points * [-1, 1, 1]
    assert np.linalg.det(procrustes(points, mirrored)[1]) == pytest.approx(1)
    assert pa_mpjpe(points, mirrored) > 0.1


def test_procrustes_is_the_least_squares_solution():
    rng = np.random.default_rng(1)
    points, goal = rng.normal(size=(8, 3)), rng.normal(size=(8, 3))
    scale, rotation, shift = procrustes(points, goal)

    def error(s, r, t):
        return ((s * points @ r.T + t - goal) ** 2).sum()

    best = error(scale, rotation, shift)
    for _ in range(200):
        nudge = Rotation.from_rotvec(0.05 * rng.normal(size=3)).as_matrix()
        assert error(scale + 0.05 * rng.normal(), nudge @ rotation, shift + 0.05 * rng.normal(size=3)) >= best


def test_views_go_round_and_leave_out_the_photo():
    rotations = view_rotations(np.array([0.0, 1.0, 0.0]))
    angles = np.degrees(np.arctan2(rotations[:, 0, 2], rotations[:, 2, 2])) % 360
    np.testing.assert_allclose(angles, 22.5 + 45 * np.arange(8))


def test_novel_views_see_what_the_photo_hides():
    """An animal seen from the front, predicted twice as long: hardly visible in the photo, plainly from the side."""
    prediction, sample = animal("a", azimuth_deg=0.0)
    longer = replace(prediction, verts=prediction.verts * [1, 1, 2])
    assert novel_view_iou(align_camera(prediction, sample.truth)) == 1
    assert novel_view_iou(align_camera(longer, sample.truth)) < 0.75
