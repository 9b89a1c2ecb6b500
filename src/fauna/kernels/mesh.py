"""Numba kernels: edges of a triangle mesh and vertex normals."""

import numpy as np
from numba import njit, prange


@njit(cache=True, error_model="numpy")
def edge_list(faces, vert_count):
    """Edges (edge, 2), sorted, with smaller index first, and up to two faces of each (edge, 2), -1 for none.

    Half-edges are put into the bucket of their smaller vertex and sorted within it; buckets hold a handful.
    """
    start = np.zeros(vert_count + 1, np.int64)
    for face in range(faces.shape[0]):
        for k in range(3):
            a, b = faces[face, k], faces[face, (k + 1) % 3]
            if a != b:
                start[min(a, b) + 1] += 1
    for vert in range(vert_count):
        start[vert + 1] += start[vert]
    fill = start[:-1].copy()
    other = np.empty(start[vert_count], np.int64)
    owner = np.empty(start[vert_count], np.int64)
    for face in range(faces.shape[0]):
        for k in range(3):
            a, b = faces[face, k], faces[face, (k + 1) % 3]
            if a == b:
                continue
            low, high = min(a, b), max(a, b)
            slot = fill[low]
            fill[low] += 1
            while slot > start[low] and other[slot - 1] > high:  # insertion sort, stable: faces stay ascending
                other[slot] = other[slot - 1]
                owner[slot] = owner[slot - 1]
                slot -= 1
            other[slot] = high
            owner[slot] = face
    return _unique_edges(start, other, owner)


@njit(cache=True, error_model="numpy")
def _unique_edges(start, other, owner):
    edges = np.empty((other.shape[0], 2), np.int64)
    edge_faces = np.full((other.shape[0], 2), -1, np.int64)
    count = 0
    for vert in range(start.shape[0] - 1):
        for slot in range(start[vert], start[vert + 1]):
            if slot > start[vert] and other[slot] == other[slot - 1]:
                if edge_faces[count - 1, 1] < 0:
                    edge_faces[count - 1, 1] = owner[slot]
                continue
            edges[count, 0] = vert
            edges[count, 1] = other[slot]
            edge_faces[count, 0] = owner[slot]
            count += 1
    return edges[:count].copy(), edge_faces[:count].copy()


@njit(cache=True, error_model="numpy")
def _two_sides(verts, faces, face):
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    u = (verts[b, 0] - verts[a, 0], verts[b, 1] - verts[a, 1], verts[b, 2] - verts[a, 2])
    v = (verts[c, 0] - verts[a, 0], verts[c, 1] - verts[a, 1], verts[c, 2] - verts[a, 2])
    return u, v


@njit(cache=True, error_model="numpy")
def _cross(u, v):
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@njit(cache=True, error_model="numpy")
def _sum_one(verts, faces, sums):
    for face in range(faces.shape[0]):
        u, v = _two_sides(verts, faces, face)
        normal = _cross(u, v)
        for k in range(3):
            for axis in range(3):
                sums[faces[face, k], axis] += normal[axis]


@njit(cache=True, error_model="numpy")
def _sum_one_backward(verts, faces, grad, grad_verts):
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        u, v = _two_sides(verts, faces, face)
        total = (
            grad[a, 0] + grad[b, 0] + grad[c, 0],
            grad[a, 1] + grad[b, 1] + grad[c, 1],
            grad[a, 2] + grad[b, 2] + grad[c, 2],
        )
        grad_u, grad_v = _cross(v, total), _cross(total, u)
        for axis in range(3):
            grad_verts[a, axis] -= grad_u[axis] + grad_v[axis]
            grad_verts[b, axis] += grad_u[axis]
            grad_verts[c, axis] += grad_v[axis]


@njit(cache=True, parallel=True, error_model="numpy")
def sum_face_normals(verts, faces):
    """(batch, vert, 3) sum over the adjacent faces of their area-scaled normals (cross products of two sides)."""
    sums = np.zeros(verts.shape, verts.dtype)
    for row in prange(verts.shape[0]):
        _sum_one(verts[row], faces, sums[row])
    return sums


@njit(cache=True, parallel=True, error_model="numpy")
def sum_face_normals_backward(verts, faces, grad):
    """Gradient (batch, vert, 3) of the vertices from that of ``sum_face_normals``."""
    grad_verts = np.zeros(verts.shape, verts.dtype)
    for row in prange(verts.shape[0]):
        _sum_one_backward(verts[row], faces, grad[row], grad_verts[row])
    return grad_verts
