"""Distances to triangles against plain search."""

import numpy as np
import trimesh

from fauna.kernels.closest_point import closest_on_triangle, nearest_in_group
from fauna.metrics.surface import Mesh, distances


def slow(point, corners):
    """Golden-ratio lattice on the triangle, refined once around the best point."""
    centre, width = np.array([1 / 3, 1 / 3]), 1.0
    for _ in range(40):
        grid = centre + width * np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 9)] * 2), -1).reshape(-1, 2)
        grid = np.clip(grid, 0, 1)
        total = grid.sum(axis=1, keepdims=True)
        grid = np.where(total > 1, grid / np.maximum(total, 1), grid)
        shares = np.column_stack([1 - grid.sum(axis=1), grid])
        away = np.linalg.norm(shares @ corners - point, axis=1)
        centre, width = grid[away.argmin()], 0.6 * width
    return away.min()


def test_closest_on_triangle_equals_a_search():
    rng = np.random.default_rng(0)
    for _ in range(60):
        corners, point = rng.normal(size=(3, 3)), 2 * rng.normal(size=3)
        u, v, w, distance2 = closest_on_triangle(point, corners)
        assert min(u, v, w) >= 0
        assert abs(u + v + w - 1) < 1e-12
        np.testing.assert_allclose(np.linalg.norm(np.array([u, v, w]) @ corners - point), np.sqrt(distance2))
        np.testing.assert_allclose(np.sqrt(distance2), slow(point, corners), rtol=2e-3)


def test_degenerate_triangles_are_points_and_segments():
    point = np.array([0.0, 3.0, 4.0])
    assert closest_on_triangle(point, np.zeros((3, 3)))[3] == 25
    segment = np.array([[-1.0, 0, 0], [1.0, 0, 0], [0.5, 0, 0]])
    np.testing.assert_allclose(closest_on_triangle(point, segment)[3], 25)


def test_groups_equal_a_search_over_their_triangles():
    rng = np.random.default_rng(1)
    corners = rng.normal(size=(50, 1, 3)) + 0.3 * rng.normal(size=(50, 3, 3))
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    points = rng.normal(size=(30, 3))
    starts = rng.integers(0, 50, 30)
    stops = np.minimum(starts + rng.integers(0, 30, 30), 50)
    triangle, shares = nearest_in_group(points, starts, stops, corners, centres, radii)
    for i in range(30):
        if starts[i] == stops[i]:
            assert triangle[i] == -1
            continue
        each = [closest_on_triangle(points[i], corners[k])[3] for k in range(starts[i], stops[i])]
        assert triangle[i] == starts[i] + int(np.argmin(each))
        np.testing.assert_allclose(np.linalg.norm(shares[i] @ corners[triangle[i]] - points[i]) ** 2, min(each))


def test_surface_distances_equal_a_search_near_and_far():
    rng = np.random.default_rng(2)
    ball = trimesh.creation.icosphere(subdivisions=2)
    verts = ball.vertices * [1.0, 0.3, 2.0]
    mesh = Mesh(np.asarray(verts), np.asarray(ball.faces))
    points = np.concatenate([rng.normal(size=(60, 3)), 20 * rng.normal(size=(20, 3)), verts[:5], [[0.0, 0.0, 0.0]]])
    expected = [min(np.sqrt(closest_on_triangle(p, c)[3]) for c in mesh.corners) for p in points]
    np.testing.assert_allclose(distances(points, mesh), expected, atol=1e-12)


def test_one_flat_triangle_is_a_surface():
    mesh = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    np.testing.assert_allclose(distances(np.array([[0.2, 0.2, 5.0], [-3.0, -4.0, 0.0]]), mesh), [5.0, 5.0])
