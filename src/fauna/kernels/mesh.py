"""Numba kernels: edges of a triangle mesh and vertex normals."""

import numpy as np
from numba import njit, prange


@njit(cache=True, error_model="numpy")
def edge_list(faces, vert_count):
    """Edges (edge, 2), sorted, with smaller index first, and up to two faces of each (edge, 2), -1 for none.

    Every vertex has a bucket for the edges of which it is the smaller one; buckets hold a handful and are kept sorted.
    """
    start = np.zeros(vert_count + 1, np.int32)
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        start[min(a, b) + 1] += 1
        start[min(b, c) + 1] += 1
        start[min(c, a) + 1] += 1
    for vert in range(vert_count):
        start[vert + 1] += start[vert]
    stop = start[:-1].copy()
    entries = np.empty((start[vert_count], 3), np.int32)  # larger vertex, first face, second face
    for face in range(faces.shape[0]):
        for k in range(3):
            a, b = faces[face, k], faces[face, k + 1 if k < 2 else 0]
            if a == b:
                continue
            low, high = min(a, b), max(a, b)
            slot = stop[low]
            while slot > start[low] and entries[slot - 1, 0] > high:
                slot -= 1
            if slot > start[low] and entries[slot - 1, 0] == high:
                if entries[slot - 1, 2] < 0:
                    entries[slot - 1, 2] = face
                continue
            for to in range(stop[low], slot, -1):
                entries[to, 0], entries[to, 1], entries[to, 2] = (
                    entries[to - 1, 0],
                    entries[to - 1, 1],
                    entries[to - 1, 2],
                )
            entries[slot, 0], entries[slot, 1], entries[slot, 2] = high, face, -1
            stop[low] += 1
    return _flatten(entries, start, stop)


@njit(cache=True, error_model="numpy")
def _flatten(entries, start, stop):
    count = 0
    for vert in range(stop.shape[0]):
        count += stop[vert] - start[vert]
    edges, edge_faces = np.empty((count, 2), np.int64), np.empty((count, 2), np.int64)
    edge = 0
    for vert in range(stop.shape[0]):
        for slot in range(start[vert], stop[vert]):
            edges[edge, 0], edges[edge, 1] = vert, entries[slot, 0]
            edge_faces[edge, 0], edge_faces[edge, 1] = entries[slot, 1], entries[slot, 2]
            edge += 1
    return edges, edge_faces


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
