"""Numba kernels: silhouette crossings and antialiasing. The rule is described in ``fauna.renderer.edges``."""

import math

import numpy as np
from numba import njit, prange


@njit(cache=True)
def _is_front(screen, faces, face):
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    ax, ay = screen[a, 0], screen[a, 1]
    return (screen[b, 0] - ax) * (screen[c, 1] - ay) - (screen[b, 1] - ay) * (screen[c, 0] - ax) > 0.0


@njit(cache=True)
def _inner_distance(first_covered, second_covered, first_depth, second_depth, edge_depth, offset, tolerance):
    """Distance of the crossing to the inner pixel (positive: the first is inner, negative: the second), NaN to reject."""
    first_inner = first_covered
    if first_covered == second_covered:
        if not first_covered or first_depth == second_depth:
            return np.nan
        first_inner = first_depth < second_depth
        if not edge_depth < max(first_depth, second_depth) - tolerance:
            return np.nan
    return offset if first_inner else offset - 1.0


@njit(cache=True)
def _cross_edge(start, end, axis, ids, depth, use_depth, tolerance, edge, best_edge, best_offset):
    """Record the crossings of one edge with the lines of pixel centres: rows for axis 0, columns for axis 1."""
    height, width = ids.shape
    along, across = 1 - axis, axis
    lines, cells = (height, width) if axis == 0 else (width, height)
    delta = end[along] - start[along]
    if delta == 0.0:
        return
    low, high = min(start[along], end[along]), max(start[along], end[along])
    first, stop = max(math.ceil(low), 0.0), min(math.ceil(high), np.float64(lines))
    if not first < stop:
        return
    for line in range(np.int64(first), np.int64(stop)):
        s = (line - start[along]) / delta
        position = start[across] + s * (end[across] - start[across])
        if not (position >= 0.0 and position < cells - 1):
            continue
        cell = np.int64(math.floor(position))
        i, j = (line, cell) if axis == 0 else (cell, line)
        k, m = (line, cell + 1) if axis == 0 else (cell + 1, line)
        near, far = 0.0, 0.0
        if use_depth:
            near, far = depth[i, j], depth[k, m]
        edge_depth = start[2] + s * (end[2] - start[2])
        offset = _inner_distance(ids[i, j] >= 0, ids[k, m] >= 0, near, far, edge_depth, position - cell, tolerance)
        if math.isnan(offset):
            continue
        if best_edge[axis, i, j] < 0 or abs(offset) > abs(best_offset[axis, i, j]):
            best_edge[axis, i, j] = edge
            best_offset[axis, i, j] = offset


@njit(cache=True)
def _cross_image(screen, faces, edges, edge_faces, ids, depth, use_depth, tolerance, both_axes, best_edge, best_offset):
    front = np.empty(faces.shape[0], np.bool_)
    for face in range(faces.shape[0]):
        front[face] = _is_front(screen, faces, face)
    for edge in range(edges.shape[0]):
        second = edge_faces[edge, 1]
        if second >= 0 and front[edge_faces[edge, 0]] == front[second]:
            continue
        start, end = screen[edges[edge, 0]], screen[edges[edge, 1]]
        if math.isnan(start[0]) or math.isnan(end[0]):
            continue
        steep = abs(end[1] - start[1]) >= abs(end[0] - start[0])
        for axis in range(2):
            if both_axes or steep == (axis == 0):
                _cross_edge(start, end, axis, ids, depth, use_depth, tolerance, edge, best_edge, best_offset)


@njit(cache=True, parallel=True)
def find_crossings(screen, faces, edges, edge_faces, ids, depth, use_depth, tolerance, both_axes):
    """For every pair of neighbouring pixels (row, axis, i, j) the accepted edge, -1 for none, and its signed offset.

    Axis 0 pairs (i, j) with (i, j + 1), axis 1 with (i + 1, j). The offset is the position of the crossing from
    the first pixel if that is the inner one, and the same minus 1 (negative) if the second one is.
    """
    rows, height, width = ids.shape
    best_edge = np.empty((rows, 2, height, width), np.int32)
    best_offset = np.empty((rows, 2, height, width), np.float64)
    for row in prange(rows):
        best_edge[row] = -1
        _cross_image(
            screen[row], faces, edges, edge_faces, ids[row], depth[min(np.int64(row), depth.shape[0] - 1)],
            use_depth, tolerance, both_axes, best_edge[row], best_offset[row],
        )  # fmt: skip
    return best_edge, best_offset


@njit(cache=True)
def blend(image, inner, outer, weight, out):
    """Add weighted differences to ``out``, a copy of ``image`` (row, chan, pixel); see ``edges.blend``."""
    size = image.shape[2]
    for k in range(inner.shape[0]):
        row = inner[k] // size
        source, target = outer[k] - row * size, inner[k] - row * size
        if weight[k] < 0.0:
            source, target = target, source
        for channel in range(image.shape[1]):
            difference = image[row, channel, source] - image[row, channel, target]
            out[row, channel, target] += abs(weight[k]) * difference


@njit(cache=True)
def blend_backward(image, inner, outer, weight, grad, grad_image, grad_weight):
    """Gradients of ``blend``: adds to ``grad_image`` (a copy of ``grad``), fills ``grad_weight`` (crossing)."""
    size = image.shape[2]
    for k in range(inner.shape[0]):
        row = inner[k] // size
        source, target = outer[k] - row * size, inner[k] - row * size
        sign = 1.0
        if weight[k] < 0.0:
            source, target = target, source
            sign = -1.0
        total = 0.0
        for channel in range(image.shape[1]):
            g = grad[row, channel, target]
            total += g * (image[row, channel, source] - image[row, channel, target])
            grad_image[row, channel, source] += abs(weight[k]) * g
            grad_image[row, channel, target] -= abs(weight[k]) * g
        grad_weight[k] = sign * total
