"""The canonical lookup against a search over all triangles, and its fallbacks."""

from dataclasses import replace

import numpy as np
import pytest

from fauna.metrics.lookup import BOTH, LEFT, RIGHT, SurfaceIndex, vertex_places
from tests.metrics.animals import animal


def slow_closest(point, corners, steps=60):
    """Nearest point of one triangle by trying many."""
    u, v = np.meshgrid(np.linspace(0, 1, steps), np.linspace(0, 1, steps))
    keep = u + v <= 1 + 1e-12
    shares = np.stack([1 - u[keep] - v[keep], u[keep], v[keep]], 1)
    return np.linalg.norm(shares @ corners - point, axis=1).min()


def slow_distance(prediction, bone, side, local):
    """Least distance over triangles and lone vertices of the same bone and side, in bone coordinates."""
    places = vertex_places(prediction)

    def allowed(face):
        sides = {int(s) for s in places.side[face]} - {BOTH}
        return side == BOTH or not sides or side in sides

    faces = [f for f in prediction.faces if (places.bone[f] == bone).all() and allowed(f)]
    in_faces = {int(v) for f in prediction.faces if (places.bone[f] == bone).all() for v in f}
    lone = [v for v in np.flatnonzero(places.bone == bone) if int(v) not in in_faces and allowed([v])]
    found = [slow_closest(local, places.local[f]) for f in faces]
    return min(found + [np.linalg.norm(places.local[v] - local) for v in lone], default=None)


def found_distance(prediction, places, weights, corners):
    return np.linalg.norm((vertex_places(prediction).local[corners] * weights[..., None]).sum(1) - places.local, axis=1)


def test_equals_a_search_over_all_triangles():
    source, _ = animal("a", rings=8, around=8)
    target, _ = animal("b", rings=9, around=10, length=2.8)
    places = vertex_places(source).rows(np.arange(0, len(source.verts), 17))
    corners, weights = SurfaceIndex.of(target).find(places)
    found = found_distance(target, places, weights, corners)
    for i, distance in enumerate(found):
        slow = slow_distance(target, places.bone[i], places.side[i], places.local[i])
        if slow is not None:
            assert distance <= slow + 1e-12
            assert distance >= slow - 0.05  # the slow search tries finitely many points
            assert (vertex_places(target).bone[corners[i]] == places.bone[i]).all()


def test_own_vertices_are_found():
    prediction, _ = animal("a")
    corners, weights = SurfaceIndex.of(prediction).find(vertex_places(prediction))
    points = (prediction.verts[corners] * weights[..., None]).sum(axis=1)
    np.testing.assert_allclose(points, prediction.verts, atol=1e-9)


def test_sides_never_mix():
    source, _ = animal("a", rings=14)
    target, _ = animal("b", rings=17, around=10)
    places = vertex_places(source)
    corners, weights = SurfaceIndex.of(target).find(places)
    x = (target.canonical[corners] * weights[..., None]).sum(axis=1)[:, 0]
    assert (x[places.side == LEFT] > -0.12).all()  # triangles across the mirror plane are narrow
    assert (x[places.side == RIGHT] < 0.12).all()
    assert (np.abs(x[places.side == LEFT]) > 0.12).any()


def test_missing_bone_falls_back_to_the_box_of_the_base_shape():
    source, _ = animal("a")
    target, _ = animal("b", length=4.8)
    without = replace(target, bone=np.where(target.bone == 0, 1, target.bone))
    places = vertex_places(source)
    nose = np.flatnonzero(places.bone == 0)
    corners, weights = SurfaceIndex.of(without).find(places.rows(nose))
    points = (target.canonical[corners] * weights[..., None]).sum(axis=1)
    expected = source.canonical[nose, 2] * 2
    assert np.abs(points[:, 2] - expected).max() < 0.3


def test_without_bones_the_box_is_used():
    first, second = (
        replace(p, bone=np.full(len(p.bone), -1), local=p.canonical)
        for p in (animal("a")[0], animal("b", length=4.8)[0])
    )
    corners, weights = SurfaceIndex.of(second).find(vertex_places(first))
    points = (second.canonical[corners] * weights[..., None]).sum(axis=1)
    np.testing.assert_allclose(points[:, 2], 2 * first.canonical[:, 2], atol=0.35)


@pytest.mark.parametrize("keep", [1, 3])
def test_any_triangle_left_is_enough(keep):
    source, _ = animal("a")
    target, _ = animal("b")
    corners, weights = SurfaceIndex.of(replace(target, faces=target.faces[:keep])).find(vertex_places(source))
    assert np.isfinite(weights).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    assert corners.max() < len(target.verts)
