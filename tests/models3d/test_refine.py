"""Subdivision against a vertex-by-vertex version of Loop's rules, and what every mesh must keep."""

import numpy as np
import pytest

from fauna.errors import FaunaError
from fauna.models3d.refine import _subdivide, refine, weld

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
CUBE_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


def octahedron() -> tuple[np.ndarray, np.ndarray]:
    verts = np.concatenate([np.eye(3), -np.eye(3)])
    faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    return verts, np.array(faces)


def slow_loop(verts: np.ndarray, faces: np.ndarray) -> tuple[dict[tuple[int, ...], np.ndarray], list[np.ndarray]]:
    """Edge points by edge and moved old vertices, one after the other (Loop, 1987)."""
    edges: dict[tuple[int, ...], list[int]] = {}
    for face in faces:
        for i in range(3):
            edges.setdefault(tuple(sorted((int(face[i]), int(face[i - 2])))), []).append(int(face[i - 1]))
    points = {}
    for (a, b), others in edges.items():
        if len(others) == 2:
            points[a, b] = 3 / 8 * (verts[a] + verts[b]) + 1 / 8 * (verts[others[0]] + verts[others[1]])
        else:
            points[a, b] = 0.5 * (verts[a] + verts[b])
    moved = []
    for vertex in range(len(verts)):
        border = [next(v for v in e if v != vertex) for e, o in edges.items() if vertex in e and len(o) != 2]
        ring = [next(v for v in e if v != vertex) for e in edges if vertex in e]
        if len(border) == 2:
            moved.append(3 / 4 * verts[vertex] + 1 / 8 * (verts[border[0]] + verts[border[1]]))
        elif border:
            moved.append(verts[vertex])
        else:
            beta = 3 / 16 if len(ring) == 3 else 3 / (8 * len(ring))
            moved.append((1 - len(ring) * beta) * verts[vertex] + beta * sum(verts[v] for v in ring))
    return points, moved


@pytest.mark.parametrize("open_", [False, True])
def test_one_round_against_the_rules(open_):
    verts, faces = CUBE, CUBE_FACES[:-3] if open_ else CUBE_FACES
    stencil, fine, _, _ = _subdivide(faces, len(verts), np.arange(len(faces)), np.tile(np.eye(3), (len(faces), 1, 1)))
    found = stencil @ verts
    points, moved = slow_loop(verts, faces)
    np.testing.assert_allclose(found[: len(verts)], moved)
    assert len(found) == len(verts) + len(points)
    quarter = len(faces)
    for face, first, second, third, inner in zip(
        faces, *(fine[i * quarter : (i + 1) * quarter] for i in range(4)), strict=True
    ):
        ab, bc, ca = (points[tuple(sorted((int(face[i]), int(face[(i + 1) % 3]))))] for i in range(3))
        a, b, c = (moved[int(vertex)] for vertex in face)
        for child, corners in (
            (first, (a, ab, ca)),
            (second, (ab, b, bc)),
            (third, (ca, bc, c)),
            (inner, (ab, bc, ca)),
        ):
            np.testing.assert_allclose(found[child], corners)


def test_counts_and_orientation():
    verts, faces = octahedron()
    fine = refine(verts, faces, target_faces=8 * 16)
    smooth = fine.fine_from_coarse @ verts
    assert fine.faces.shape == (128, 3)
    assert smooth.shape == (66, 3)  # Euler: 66 - 192 + 128 = 2
    a, b, c = (smooth[fine.faces[:, i]] for i in range(3))
    assert ((np.cross(b - a, c - a) * (a + b + c)).sum(1) > 0).all()
    np.testing.assert_allclose(np.asarray(fine.fine_from_coarse.sum(1)).ravel(), 1)


def test_surface_passes_near_the_given_vertices():
    """The plain limit of an octahedron shrinks to two thirds; the fitted one stays within a tenth."""
    verts, faces = octahedron()
    fine = refine(verts, faces, target_faces=8 * 64)
    reached = np.linalg.norm((fine.fine_from_coarse @ verts)[:6], axis=1)
    assert (reached > 0.75).all()
    assert (reached < 1.05).all()


def test_split_corners_are_joined_and_degenerate_faces_dropped():
    verts, faces = octahedron()
    split = verts[faces.ravel()]
    flat = np.concatenate([np.arange(24).reshape(8, 3), [[0, 0, 1]]])
    assert len(np.unique(weld(split))) == 6
    fine = refine(split, flat, target_faces=32)
    whole = refine(verts, faces, target_faces=32)
    assert fine.faces.shape == (32, 3)
    assert set(np.unique(fine.corner_faces)) == set(range(8))
    ours, theirs = fine.fine_from_coarse @ split, whole.fine_from_coarse @ verts
    np.testing.assert_allclose(ours[np.lexsort(ours.round(9).T)], theirs[np.lexsort(theirs.round(9).T)], atol=1e-9)
    with pytest.raises(FaunaError, match="triangles that have an area"):
        refine(verts, np.array([[0, 0, 1]]), target_faces=8)


def test_corner_shares_say_where_in_its_coarse_face_a_fine_face_lies():
    verts, faces = octahedron()
    fine = refine(verts, faces, target_faces=8 * 16)
    np.testing.assert_allclose(fine.corner_shares.sum(-1), 1)
    flat = np.einsum("fcb,fbk->fck", fine.corner_shares, verts[faces[fine.corner_faces]])
    area = np.linalg.norm(np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]), axis=1)
    np.testing.assert_allclose(area, np.sqrt(3) / 16)  # every fine face is a sixteenth of its coarse one
    np.testing.assert_allclose(np.abs(flat).sum(-1), 1)  # on the octahedron


def test_smoothing_commutes_with_motions_and_keeps_symmetry():
    verts, faces = octahedron()
    fine = refine(verts, faces, target_faces=128)
    rotation, shift = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0], np.array([1.0, 2, 3])
    np.testing.assert_allclose(
        fine.fine_from_coarse @ (verts @ rotation + shift), fine.fine_from_coarse @ verts @ rotation + shift, atol=1e-12
    )
    smooth = fine.fine_from_coarse @ verts
    mirrored = smooth * [-1, 1, 1]
    assert np.linalg.norm(smooth[:, None] - mirrored[None], axis=-1).min(1).max() < 1e-12
