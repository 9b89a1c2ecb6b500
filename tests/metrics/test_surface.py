"""Areas, samples, Chamfer distance, F-score and volumes of shapes whose values are known."""

import numpy as np
import pytest
import trimesh

from fauna.metrics.surface import Mesh, centroid, chamfer_and_f_score, face_areas, surface_points, volume_iou, voxels


def mesh_of(solid):
    return Mesh(np.asarray(solid.vertices, np.float64), np.asarray(solid.faces))


def box(*extents, at=(0.0, 0.0, 0.0)):
    solid = trimesh.creation.box(extents)
    solid.apply_translation(at)
    return mesh_of(solid)


def join(*meshes):
    offsets = np.cumsum([0] + [len(m.verts) for m in meshes[:-1]])
    faces = np.concatenate([m.faces + offset for m, offset in zip(meshes, offsets, strict=True)])
    return Mesh(np.concatenate([m.verts for m in meshes]), faces)


def winding_number(points, mesh):
    """Generalised winding number by solid angles (van Oosterom and Strackee, 1983)."""
    total = np.zeros(len(points))
    for a, b, c in mesh.corners:
        a, b, c = a - points, b - points, c - points
        la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
        triple = (a * np.cross(b, c)).sum(axis=1)
        rest = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        total += np.arctan2(triple, rest) / (2 * np.pi)
    return total


def test_areas_and_centroid():
    mesh = box(1, 2, 3, at=(5, 0, 0))
    assert face_areas(mesh).sum() == pytest.approx(22)
    np.testing.assert_allclose(centroid(mesh), [5, 0, 0], atol=1e-12)


def test_points_lie_on_the_surface_uniformly():
    mesh = box(1, 1, 4)
    points = surface_points(mesh, count=9000, rng=np.random.default_rng(0))
    on = np.isclose(np.abs(points) * 2, [1, 1, 4]).any(axis=1)
    assert on.all()
    on_ends = np.isclose(np.abs(points[:, 2]), 2).mean()
    assert on_ends == pytest.approx(2 / 18, abs=0.01)


def test_chamfer_of_parallel_squares_is_their_distance():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    first, second = Mesh(square, faces), Mesh(square + [0, 0, 0.3], faces)
    for threshold, expected in ((0.29, 0.0), (0.31, 1.0)):
        rng = np.random.default_rng(0)
        chamfer, f_score = chamfer_and_f_score(first, second, threshold=threshold, count=100, rng=rng)
        assert chamfer == pytest.approx(0.3)
        assert f_score == expected


def test_f_score_is_the_harmonic_mean():
    long, short = box(1, 1, 4), box(1, 1, 2, at=(0, 0, 1))
    rng = np.random.default_rng(0)
    _, f_score = chamfer_and_f_score(short, long, threshold=1e-9, count=4000, rng=rng)
    precision, recall = 9 / 10, 9 / 18  # shares of either area that lie on the other
    assert f_score == pytest.approx(2 * precision * recall / (precision + recall), abs=0.02)


def test_volume_iou_of_shifted_boxes():
    assert volume_iou(box(1, 1, 1), box(1, 1, 1, at=(0.5, 0, 0))) == pytest.approx(1 / 3, abs=0.02)
    assert volume_iou(box(1, 1, 1), box(1, 1, 1, at=(3, 0, 0))) == 0
    assert volume_iou(box(1, 2, 1), box(1, 2, 1)) == 1


@pytest.mark.parametrize("solid", ["closed", "overlapping", "nested", "open"])
def test_inside_agrees_with_the_winding_number(solid):
    ball = mesh_of(trimesh.creation.icosphere(subdivisions=2))
    other = Mesh(ball.verts * 0.6 + [0.9, 0.1, 0.0], ball.faces)
    meshes = {
        "closed": ball,
        "overlapping": join(ball, other),
        "nested": join(ball, Mesh(0.5 * ball.verts, ball.faces)),
        "open": Mesh(ball.verts, ball.faces[ball.verts[ball.faces].mean(axis=1)[:, 1] < 0.9]),
    }
    mesh = meshes[solid]
    low, size, shape = np.array([-1.1, -1.1, -1.1]), 0.11, (25, 20, 20)
    inside = voxels(mesh, low, size, shape)
    centres = low + (np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1) + 0.5) * size
    expected = (winding_number(centres.reshape(-1, 3), mesh) > 0.5).reshape(shape)
    assert expected.any()
    disagreeing = (inside != expected).sum() / expected.sum()
    assert disagreeing <= (0.05 if solid == "open" else 0.0)


def test_edges_through_cell_centres_are_crossed_once():
    """Boxes whose edges run exactly through centres: no column may be counted twice or not at all."""
    mesh = box(2, 2, 2)
    inside = voxels(mesh, np.array([-2.5, -2.5, -2.5]), 1.0, (5, 5, 5))
    assert inside[2, 2, 2]
    assert inside.sum() in (1, 2, 4, 8, 12, 18, 27)
    assert not inside[[0, -1]].any()


def test_nothing_has_no_volume():
    flat = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    assert volume_iou(flat, flat) == 1
