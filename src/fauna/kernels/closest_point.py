"""Numba kernels: the nearest point on triangles, within groups of triangles and on a whole surface.

Triangles may be degenerate: a point is three equal corners. Of equally near triangles the first is taken.
"""

import math

import numpy as np
from numba import njit


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
def _cell(value, low, size, count):
    return min(max(np.int64(math.floor((value - low) / size)), 0), count - 1)


@njit(cache=True)
def fill_grid(corners, low, size, shape):
    """Triangles by grid cell: offsets (cell + 1,) and triangle indices; a triangle is listed in every cell its box meets."""
    cells = shape[0] * shape[1] * shape[2]
    offsets = np.zeros(cells + 1, np.int64)
    ranges = np.empty((len(corners), 6), np.int64)
    for k in range(len(corners)):
        for axis in range(3):
            a, b, c = corners[k, 0, axis], corners[k, 1, axis], corners[k, 2, axis]
            ranges[k, axis] = _cell(min(a, b, c), low[axis], size, shape[axis])
            ranges[k, 3 + axis] = _cell(max(a, b, c), low[axis], size, shape[axis])
        for x in range(ranges[k, 0], ranges[k, 3] + 1):
            for y in range(ranges[k, 1], ranges[k, 4] + 1):
                for z in range(ranges[k, 2], ranges[k, 5] + 1):
                    offsets[(x * shape[1] + y) * shape[2] + z + 1] += 1
    offsets = np.cumsum(offsets)
    place = offsets[:-1].copy()
    members = np.empty(offsets[-1], np.int64)
    for k in range(len(corners)):
        for x in range(ranges[k, 0], ranges[k, 3] + 1):
            for y in range(ranges[k, 1], ranges[k, 4] + 1):
                for z in range(ranges[k, 2], ranges[k, 5] + 1):
                    cell = (x * shape[1] + y) * shape[2] + z
                    members[place[cell]] = k
                    place[cell] += 1
    return offsets, members


@njit(cache=True)
def distances_to_surface(points, corners, low, size, shape, offsets, members):
    """Exact distance from each point to the nearest triangle; cells are searched in growing cubes around the point."""
    result = np.empty(len(points))
    home = np.empty(3, np.int64)
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    rings = max(shape[0], shape[1], shape[2])
    for i in range(len(points)):
        p = points[i]
        for axis in range(3):
            home[axis] = _cell(p[axis], low[axis], size, shape[axis])
        best = np.inf
        for ring in range(rings):
            if ring > 0 and ((ring - 1) * size) ** 2 >= best:  # what is listed only from this ring on is no nearer
                break
            for axis in range(3):
                first[axis], last[axis] = max(home[axis] - ring, 0), min(home[axis] + ring, shape[axis] - 1)
            for x in range(first[0], last[0] + 1):
                for y in range(first[1], last[1] + 1):
                    edge = abs(x - home[0]) == ring or abs(y - home[1]) == ring
                    step = 1 if edge or ring == 0 else 2 * ring
                    start = home[2] - ring
                    for z in range(start, home[2] + ring + 1, step):
                        if z < 0 or z >= shape[2]:
                            continue
                        cell = (x * shape[1] + y) * shape[2] + z
                        for m in range(offsets[cell], offsets[cell + 1]):
                            distance2 = closest_on_triangle(p, corners[members[m]])[3]
                            if distance2 < best:
                                best = distance2
        result[i] = math.sqrt(best)
    return result
