"""Numba kernels: the nearest point on triangles, within groups of triangles and on a whole surface.

Triangles may be degenerate: a point is three equal corners. Of equally near triangles the first is taken.
"""

import math

import numpy as np
from numba import njit

LEAF = 8  # triangles of the smallest boxes


@njit(cache=True, inline="always")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def _closest_on_segment(p, a, b):
    """Parameter in [0, 1] of the nearest point of a + t (b - a)."""
    length = along = 0.0
    for axis in range(3):
        step = b[axis] - a[axis]
        length += step * step
        along += step * (p[axis] - a[axis])
    if length <= 0.0:
        return 0.0
    return min(max(along / length, 0.0), 1.0)


@njit(cache=True)
def _distance2(p, corners, u, v, w):
    total = 0.0
    for axis in range(3):
        step = p[axis] - u * corners[0, axis] - v * corners[1, axis] - w * corners[2, axis]
        total += step * step
    return total


@njit(cache=True)
def closest_on_triangle(p, corners):
    """Barycentrics of the point of a triangle nearest to ``p``, and the squared distance.

    The foot of the perpendicular if it lies inside, otherwise the best point of the three sides.
    """
    e0, e1, ep = np.empty(3), np.empty(3), np.empty(3)
    for axis in range(3):
        e0[axis] = corners[1, axis] - corners[0, axis]
        e1[axis] = corners[2, axis] - corners[0, axis]
        ep[axis] = p[axis] - corners[0, axis]
    d00, d01, d11, d0, d1 = _dot(e0, e0), _dot(e0, e1), _dot(e1, e1), _dot(e0, ep), _dot(e1, ep)
    area = d00 * d11 - d01 * d01
    if area > 1e-14 * d00 * d11:
        v, w = (d11 * d0 - d01 * d1) / area, (d00 * d1 - d01 * d0) / area
        if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
            return 1.0 - v - w, v, w, _distance2(p, corners, 1.0 - v - w, v, w)
    best_u, best_v, best_w, best = 1.0, 0.0, 0.0, np.inf
    for side in range(3):
        t = _closest_on_segment(p, corners[side], corners[(side + 1) % 3])
        u = 1.0 - t if side == 0 else (t if side == 2 else 0.0)
        v = 1.0 - t if side == 1 else (t if side == 0 else 0.0)
        w = 1.0 - t if side == 2 else (t if side == 1 else 0.0)
        distance2 = _distance2(p, corners, u, v, w)
        if distance2 < best:
            best_u, best_v, best_w, best = u, v, w, distance2
    return best_u, best_v, best_w, best


@njit(cache=True)
def nearest_in_group(points, starts, stops, corners, centres, radii):
    """For each point the nearest of the triangles ``starts[i] .. stops[i]`` and its barycentrics; triangle -1 for none.

    ``centres`` and ``radii`` bound the triangles: most are passed over by one comparison.
    """
    number = len(points)
    triangle = np.full(number, -1, np.int64)
    barycentrics = np.zeros((number, 3))
    for i in range(number):
        best = np.inf
        reach = np.inf
        for k in range(starts[i], stops[i]):
            far2 = 0.0
            for axis in range(3):
                step = points[i, axis] - centres[k, axis]
                far2 += step * step
            bound = reach + radii[k]
            if far2 > bound * bound:
                continue
            u, v, w, distance2 = closest_on_triangle(points[i], corners[k])
            if distance2 < best:
                best, triangle[i] = distance2, k
                reach = math.sqrt(distance2)
                barycentrics[i, 0], barycentrics[i, 1], barycentrics[i, 2] = u, v, w
    return triangle, barycentrics


@njit(cache=True)
def build_tree(corners):
    """Bounding boxes of a balanced binary tree over triangles.

    Returns:
        ``order``: triangles, those of a node side by side. ``ranges``: (node, 2) places in ``order``. ``boxes``: (node, 2, 3) least
        and greatest corner. The children of node i are 2 i + 1 and 2 i + 2; nodes of at most ``LEAF`` triangles have none.
    """
    number = len(corners)
    inner = 1
    while number > inner * LEAF:
        inner *= 2
    ranges = np.zeros((2 * inner - 1, 2), np.int64)
    boxes = np.empty((2 * inner - 1, 2, 3))
    order = np.arange(number)
    ranges[0, 1] = number
    for node in range(2 * inner - 1):
        start, stop = ranges[node, 0], ranges[node, 1]
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for place in range(start, stop):
            for corner in range(3):
                for axis in range(3):
                    value = corners[order[place], corner, axis]
                    low[axis], high[axis] = min(low[axis], value), max(high[axis], value)
        boxes[node, 0], boxes[node, 1] = low, high
        if 2 * node + 2 < len(ranges):
            axis = np.argmax(high - low)
            members = order[start:stop]
            keys = np.empty(stop - start)
            for k in range(stop - start):
                keys[k] = corners[members[k], 0, axis] + corners[members[k], 1, axis] + corners[members[k], 2, axis]
            order[start:stop] = members[np.argsort(keys, kind="mergesort")]
            middle = (start + stop) // 2
            ranges[2 * node + 1, 0], ranges[2 * node + 1, 1] = start, middle
            ranges[2 * node + 2, 0], ranges[2 * node + 2, 1] = middle, stop
    return order, ranges, boxes


@njit(cache=True)
def _box_distance2(p, box):
    total = 0.0
    for axis in range(3):
        step = max(box[0, axis] - p[axis], p[axis] - box[1, axis], 0.0)
        total += step * step
    return total


@njit(cache=True)
def distances_to_surface(points, corners, order, ranges, boxes):
    """Exact distance from each point to the nearest triangle of a tree of :func:`build_tree`, nearer child first."""
    result = np.empty(len(points))
    stack = np.empty(128, np.int64)
    for i in range(len(points)):
        p = points[i]
        best = np.inf
        stack[0], waiting = 0, 1
        while waiting:
            waiting -= 1
            node = stack[waiting]
            if _box_distance2(p, boxes[node]) >= best:
                continue
            if 2 * node + 2 >= len(ranges):
                for place in range(ranges[node, 0], ranges[node, 1]):
                    best = min(best, closest_on_triangle(p, corners[order[place]])[3])
                continue
            first, second = 2 * node + 1, 2 * node + 2
            if _box_distance2(p, boxes[second]) < _box_distance2(p, boxes[first]):
                first, second = second, first
            stack[waiting], stack[waiting + 1] = second, first
            waiting += 2
        result[i] = math.sqrt(best)
    return result
