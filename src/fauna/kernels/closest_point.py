"""Numba kernels: the nearest point on triangles, within groups of triangles and on a whole surface.

Triangles may be degenerate: a point is three equal corners. Of equally near triangles the first is taken.
"""

import math

import numpy as np
from numba import njit

LEAF = 8  # triangles of the smallest boxes


@njit(cache=True, inline="always")
def _on_segment(px, py, pz, dx, dy, dz):
    """Parameter in [0, 1] of the point t d nearest to p."""
    length = dx * dx + dy * dy + dz * dz
    if length <= 0.0:
        return 0.0
    return min(max((px * dx + py * dy + pz * dz) / length, 0.0), 1.0)


@njit(cache=True)
def closest_on_triangle(p, corners):
    """Barycentrics of the point of a triangle nearest to ``p``, and the squared distance.

    The foot of the perpendicular if it lies inside, otherwise the best point of the three sides.
    """
    px, py, pz = p[0] - corners[0, 0], p[1] - corners[0, 1], p[2] - corners[0, 2]
    ax, ay, az = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1], corners[1, 2] - corners[0, 2]
    bx, by, bz = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1], corners[2, 2] - corners[0, 2]
    aa, ab, bb = ax * ax + ay * ay + az * az, ax * bx + ay * by + az * bz, bx * bx + by * by + bz * bz
    pa, pb = px * ax + py * ay + pz * az, px * bx + py * by + pz * bz
    area = aa * bb - ab * ab
    if area > 1e-14 * aa * bb:
        v, w = (bb * pa - ab * pb) / area, (aa * pb - ab * pa) / area
        if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
            dx, dy, dz = px - v * ax - w * bx, py - v * ay - w * by, pz - v * az - w * bz
            return max(1.0 - v - w, 0.0), v, w, dx * dx + dy * dy + dz * dz
    v = _on_segment(px, py, pz, ax, ay, az)
    dx, dy, dz = px - v * ax, py - v * ay, pz - v * az
    best_v, best_w, best = v, 0.0, dx * dx + dy * dy + dz * dz
    w = _on_segment(px, py, pz, bx, by, bz)
    dx, dy, dz = px - w * bx, py - w * by, pz - w * bz
    distance2 = dx * dx + dy * dy + dz * dz
    if distance2 < best:
        best_v, best_w, best = 0.0, w, distance2
    w = _on_segment(px - ax, py - ay, pz - az, bx - ax, by - ay, bz - az)
    v = 1.0 - w
    dx, dy, dz = px - v * ax - w * bx, py - v * ay - w * by, pz - v * az - w * bz
    distance2 = dx * dx + dy * dy + dz * dz
    if distance2 < best:
        best_v, best_w, best = v, w, distance2
    return max(1.0 - best_v - best_w, 0.0), best_v, best_w, best


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
def morton_codes(corners):
    """Place of each triangle's centre on a space-filling curve (1024 cells per axis): near codes are near in space."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for k in range(len(corners)):
        for axis in range(3):
            value = corners[k, 0, axis] + corners[k, 1, axis] + corners[k, 2, axis]
            low[axis], high[axis] = min(low[axis], value), max(high[axis], value)
    codes = np.zeros(len(corners), np.int64)
    for k in range(len(corners)):
        for axis in range(3):
            value = corners[k, 0, axis] + corners[k, 1, axis] + corners[k, 2, axis]
            extent = max(high[axis] - low[axis], 1e-300)
            cell = min(np.int64((value - low[axis]) / extent * 1024.0), 1023)
            for bit in range(10):
                codes[k] |= ((cell >> bit) & 1) << (3 * bit + axis)
    return codes


@njit(cache=True)
def build_tree(corners, order):
    """Bounding boxes of a balanced binary tree over triangles in a spatial order.

    Returns:
        ``ranges``: (node, 2) places in ``order``; ``boxes``: (node, 2, 3) least and greatest corner. The children of node i are 2 i + 1
        and 2 i + 2; nodes of at most ``LEAF`` triangles have none.
    """
    inner = 1
    while len(corners) > inner * LEAF:
        inner *= 2
    ranges = np.zeros((2 * inner - 1, 2), np.int64)
    ranges[0, 1] = len(corners)
    for node in range(inner - 1):
        start, stop = ranges[node]
        ranges[2 * node + 1] = start, (start + stop) // 2
        ranges[2 * node + 2] = (start + stop) // 2, stop
    boxes = np.empty((2 * inner - 1, 2, 3))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    for node in range(2 * inner - 2, -1, -1):
        if node >= inner - 1:
            for place in range(ranges[node, 0], ranges[node, 1]):
                for corner in range(3):
                    for axis in range(3):
                        value = corners[order[place], corner, axis]
                        boxes[node, 0, axis] = min(boxes[node, 0, axis], value)
                        boxes[node, 1, axis] = max(boxes[node, 1, axis], value)
        if node > 0:
            parent = (node - 1) // 2
            for axis in range(3):
                boxes[parent, 0, axis] = min(boxes[parent, 0, axis], boxes[node, 0, axis])
                boxes[parent, 1, axis] = max(boxes[parent, 1, axis], boxes[node, 1, axis])
    return ranges, boxes


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
