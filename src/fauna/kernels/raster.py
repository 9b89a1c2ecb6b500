"""Numba kernels: projection to the screen and the z-buffer.

Plain numpy arrays in, numpy arrays out; the meaning of every step is given in ``fauna.renderer.torch_backend``.
Every parallel loop runs over (image, band of rows) tasks that write memory of their own, so results depend
neither on scheduling nor on the number of threads.
"""

import math

import numpy as np
from numba import njit, prange

SNAP = 65536.0  # screen positions are rounded to 1/65536 px: edge functions are then exact in float64
MIN_AREA2 = 2.0**-20  # twice the area in px^2 below which a triangle is treated as seen edge-on
MIN_W = 1e-6


@njit(cache=True)
def _project_vertex(clip, height, width, snap, out):
    w = np.float64(clip[3])
    if not (w > MIN_W and math.isfinite(w)):
        out[0] = np.nan
        out[1] = np.nan
        out[2] = np.nan
        return
    x = (np.float64(clip[0]) / w + 1.0) * (0.5 * width) - 0.5
    y = (np.float64(clip[1]) / w + 1.0) * (0.5 * height) - 0.5
    z = np.float64(clip[2]) / w
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        x = np.nan
    if snap:
        x = np.rint(x * SNAP) / SNAP
        y = np.rint(y * SNAP) / SNAP
    out[0] = x
    out[1] = y
    out[2] = z


@njit(cache=True, parallel=True)
def project(clip, height, width, snap):
    """Screen positions (x px, y px, NDC z) in float64 of (row, vert, 4) clip positions; x is NaN where w <= 0."""
    rows, verts = clip.shape[0], clip.shape[1]
    screen = np.empty((rows, verts, 3), np.float64)
    for row in prange(rows):
        for vert in range(verts):
            _project_vertex(clip[row, vert], height, width, snap, screen[row, vert])
    return screen


@njit(cache=True, inline="always")
def _first_pixel(a, b, c, start):
    return max(math.ceil(min(a, b, c)), np.float64(start))


@njit(cache=True, inline="always")
def _last_pixel(a, b, c, stop):
    return min(math.floor(max(a, b, c)), np.float64(stop - 1))


@njit(cache=True)
def _raster_band(screen, faces, start, stop, ids, depth, z_test):
    """Draw all triangles of one image into the pixel rows [start, stop)."""
    width = ids.shape[1]
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ay, by, cy = screen[a, 1], screen[b, 1], screen[c, 1]
        top, bottom = _first_pixel(ay, by, cy, start), _last_pixel(ay, by, cy, stop)
        if not top <= bottom:
            continue
        ax, bx, cx = screen[a, 0], screen[b, 0], screen[c, 0]
        left, right = _first_pixel(ax, bx, cx, 0), _last_pixel(ax, bx, cx, width)
        if not left <= right:
            continue
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if not abs(area) > MIN_AREA2:  # also true for NaN
            continue
        az, bz, cz = screen[a, 2], screen[b, 2], screen[c, 2]
        sign = 1.0 if area > 0.0 else -1.0
        area *= sign
        for i in range(np.int64(top), np.int64(bottom) + 1):
            for j in range(np.int64(left), np.int64(right) + 1):
                if not z_test and ids[i, j] >= 0:
                    continue
                e0 = sign * ((cx - bx) * (i - by) - (cy - by) * (j - bx))
                e1 = sign * ((ax - cx) * (i - cy) - (ay - cy) * (j - cx))
                e2 = sign * ((bx - ax) * (i - ay) - (by - ay) * (j - ax))
                if e0 >= 0.0 and e1 >= 0.0 and e2 >= 0.0:
                    if z_test:
                        z = (e0 * az + e1 * bz + e2 * cz) / area
                        if z < depth[i, j]:
                            depth[i, j] = z
                            ids[i, j] = face
                    else:
                        ids[i, j] = face


@njit(cache=True, parallel=True)
def rasterize(screen, faces, height, width, bands):
    """Nearest face (row, height, width), -1 for none, and its NDC depth, +inf for none."""
    rows = screen.shape[0]
    ids = np.empty((rows, height, width), np.int64)
    depth = np.empty((rows, height, width), np.float64)
    for task in prange(rows * bands):
        row, band = np.int64(task) // bands, np.int64(task) % bands
        start, stop = band * height // bands, (band + 1) * height // bands
        ids[row, start:stop] = -1
        depth[row, start:stop] = np.inf
        _raster_band(screen[row], faces, start, stop, ids[row], depth[row], True)
    return ids, depth


@njit(cache=True, parallel=True)
def cover(screen, faces, height, width, bands):
    """Some face (row, height, width) that covers the pixel centre, -1 for none: no depth test."""
    rows = screen.shape[0]
    ids = np.empty((rows, height, width), np.int32)
    no_depth = np.empty((1, 1), np.float64)
    for task in prange(rows * bands):
        row, band = np.int64(task) // bands, np.int64(task) % bands
        start, stop = band * height // bands, (band + 1) * height // bands
        ids[row, start:stop] = -1
        _raster_band(screen[row], faces, start, stop, ids[row], no_depth, False)
    return ids
