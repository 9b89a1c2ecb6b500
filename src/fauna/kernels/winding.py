"""Numba kernel: signed crossings of axis-parallel lines with triangles, the ingredients of a robust inside test."""

import math

import numpy as np
from numba import njit


@njit(cache=True)
def crossings_along_z(corners, low, size, shape):
    """Signed crossings of the vertical lines through the centres of an (x, y) grid.

    Args:
        corners: (face, 3, 3), counter-clockwise seen from outside.
        low: (3,) corner of the grid.
        size: side of a cell.
        shape: cells along x, y, z.

    Returns:
        (nx, ny, nz + 1) int32: +1 where the line through a column enters the solid going up, -1 where it leaves; entry k
        holds the crossings between the centres of cells k - 1 and k. Triangles share sides by a top-left rule: a line
        through a common side crosses exactly one of two neighbours.
    """
    nx, ny, nz = shape
    found = np.zeros((nx, ny, nz + 1), np.int32)
    for f in range(len(corners)):
        ax, ay = (corners[f, 0, 0] - low[0]) / size - 0.5, (corners[f, 0, 1] - low[1]) / size - 0.5
        bx, by = (corners[f, 1, 0] - low[0]) / size - 0.5, (corners[f, 1, 1] - low[1]) / size - 0.5
        cx, cy = (corners[f, 2, 0] - low[0]) / size - 0.5, (corners[f, 2, 1] - low[1]) / size - 0.5
        az, bz, cz = corners[f, 0, 2], corners[f, 1, 2], corners[f, 2, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        sign = -1 if area > 0.0 else 1  # the outside normal looks up: the line leaves
        if area < 0.0:
            bx, by, bz, cx, cy, cz = cx, cy, cz, bx, by, bz
            area = -area
        i0, i1 = max(math.ceil(min(ax, bx, cx)), 0), min(math.floor(max(ax, bx, cx)), nx - 1)
        j0, j1 = max(math.ceil(min(ay, by, cy)), 0), min(math.floor(max(ay, by, cy)), ny - 1)
        for i in range(int(i0), int(i1) + 1):
            for j in range(int(j0), int(j1) + 1):
                e0, in0 = _edge(bx, by, cx, cy, i, j)
                e1, in1 = _edge(cx, cy, ax, ay, i, j)
                e2, in2 = _edge(ax, ay, bx, by, i, j)
                if in0 and in1 and in2:
                    z = (e0 * az + e1 * bz + e2 * cz) / area
                    k = math.ceil((z - low[2]) / size - 0.5)
                    found[i, j, min(max(int(k), 0), nz)] += sign
    return found


@njit(cache=True, inline="always")
def _edge(ax, ay, bx, by, x, y):
    """Edge function, evaluated the same for both directions of an edge, and whether the point counts as inside."""
    if ax < bx or (ax == bx and ay < by):
        value = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        return value, value > 0.0
    value = -((ax - bx) * (y - by) - (ay - by) * (x - bx))
    return value, value >= 0.0
