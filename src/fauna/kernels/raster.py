"""Numba kernels: projection to the screen and the z-buffer.

Plain numpy arrays in, numpy arrays out; the meaning of every step is given in ``fauna.renderer.torch_backend``.
Every parallel loop runs over (image, band of rows) tasks that write memory of their own, so results depend
neither on scheduling nor on the number of threads.
"""

import math

import numpy as np
from numba import njit, prange

from fauna.kernels.barycentrics import fill_rows

SNAP = 65536.0  # screen positions are rounded to 1/65536 px: edge functions are then exact in float64
MIN_AREA2 = 2.0**-20  # twice the area in px^2 below which a triangle is treated as seen edge-on
MIN_W = 1e-6


@njit(cache=True, error_model="numpy")
def screen_position(clip, vert, height, width):
    """Screen x, y (pixels) and NDC z of a vertex in float64; x is NaN if it is behind the camera or not finite."""
    w = np.float64(clip[vert, 3])
    x = (np.float64(clip[vert, 0]) / w + 1.0) * (0.5 * width) - 0.5
    y = (np.float64(clip[vert, 1]) / w + 1.0) * (0.5 * height) - 0.5
    z = np.float64(clip[vert, 2]) / w
    if not (w > MIN_W and math.isfinite(w) and math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        x = np.nan
    return x, y, z


@njit(cache=True, error_model="numpy")
def _project_part(clip, height, width, start, stop, screen):
    for vert in range(start, stop):
        x, y, z = screen_position(clip, vert, height, width)
        screen[vert, 0] = np.rint(x * SNAP) / SNAP
        screen[vert, 1] = np.rint(y * SNAP) / SNAP
        screen[vert, 2] = z


@njit(cache=True, parallel=True, error_model="numpy")
def project(clip, height, width, bands):
    """Snapped screen positions (row, vert, 3) in float64."""
    rows, verts = clip.shape[0], clip.shape[1]
    screen = np.empty((rows, verts, 3), np.float64)
    for task in prange(rows * bands):
        row, band = np.int64(task) // bands, np.int64(task) % bands
        start, stop = band * verts // bands, (band + 1) * verts // bands
        _project_part(clip[row], height, width, start, stop, screen[row])
    return screen


@njit(cache=True, error_model="numpy")
def _touching(screen, faces, start, stop, width, found):
    """Collect the faces with a pixel centre in their bounding box; no branch, as half of the small ones have none."""
    count = 0
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, bx, cx = screen[a, 0], screen[b, 0], screen[c, 0]
        ay, by, cy = screen[a, 1], screen[b, 1], screen[c, 1]
        left, right = np.ceil(max(min(ax, bx, cx), 0.0)), min(max(ax, bx, cx), width - 1.0)
        top, bottom = np.ceil(max(min(ay, by, cy), np.float64(start))), min(max(ay, by, cy), stop - 1.0)
        found[count] = face
        count += np.int64(left <= right) & np.int64(top <= bottom)
    return count


@njit(cache=True, error_model="numpy")
def _draw(screen, faces, start, stop, ids, depth, z_test):
    """Draw all triangles of one image into the pixel rows [start, stop); without depth test any of them is kept."""
    width = ids.shape[1]
    found = np.empty(faces.shape[0] + 1, np.int32)
    for k in range(_touching(screen, faces, start, stop, width, found)):
        face = found[k]
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, bx, cx = screen[a, 0], screen[b, 0], screen[c, 0]
        ay, by, cy = screen[a, 1], screen[b, 1], screen[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if not abs(area) > MIN_AREA2:  # also true for NaN
            continue
        left, right = np.int64(np.ceil(max(min(ax, bx, cx), 0.0))), np.int64(min(max(ax, bx, cx), width - 1.0))
        top, bottom = (
            np.int64(np.ceil(max(min(ay, by, cy), np.float64(start)))),
            np.int64(min(max(ay, by, cy), stop - 1.0)),
        )
        az, bz, cz = screen[a, 2], screen[b, 2], screen[c, 2]
        sign = 1.0 if area > 0.0 else -1.0
        area *= sign
        for i in range(top, bottom + 1):
            for j in range(left, right + 1):
                e0 = sign * ((cx - bx) * (i - by) - (cy - by) * (j - bx))
                e1 = sign * ((ax - cx) * (i - cy) - (ay - cy) * (j - cx))
                e2 = sign * ((bx - ax) * (i - ay) - (by - ay) * (j - ax))
                if min(e0, e1, e2) >= 0.0:
                    if z_test:
                        z = (e0 * az + e1 * bz + e2 * cz) / area
                        if z < depth[i - start, j]:
                            depth[i - start, j] = z
                            ids[i, j] = face
                    else:
                        ids[i, j] = 1


@njit(cache=True, error_model="numpy")
def _draw_band(clip, screen, faces, start, stop, ids, depth, barycentrics):
    """Everything that is seen in the pixel rows [start, stop) of one image."""
    width = ids.shape[1]
    z_buffer = np.empty((stop - start, width), np.float64)
    for i in range(start, stop):
        for j in range(width):
            ids[i, j], z_buffer[i - start, j] = -1, np.inf
    _draw(screen, faces, start, stop, ids, z_buffer, True)
    for i in range(start, stop):
        for j in range(width):
            depth[i, j] = z_buffer[i - start, j]
    fill_rows(clip, faces, ids, start, stop, barycentrics)


@njit(cache=True, parallel=True, error_model="numpy")
def rasterize(clip, screen, faces, height, width, bands):
    """Nearest face (row, height, width), -1 for none; its NDC depth, +inf for none; its barycentrics (..., 3)."""
    rows = screen.shape[0]
    ids = np.empty((rows, height, width), np.int64)
    depth = np.empty((rows, height, width), clip.dtype)
    barycentrics = np.empty((rows, height, width, 3), clip.dtype)
    for task in prange(rows * bands):
        row, band = np.int64(task) // bands, np.int64(task) % bands
        start, stop = band * height // bands, (band + 1) * height // bands
        _draw_band(clip[row], screen[row], faces, start, stop, ids[row], depth[row], barycentrics[row])
    return ids, depth, barycentrics


@njit(cache=True, error_model="numpy")
def _cover_band(screen, faces, start, stop, covered):
    covered[start:stop] = -1
    _draw(screen, faces, start, stop, covered, np.empty((1, 1), np.float64), False)


@njit(cache=True, parallel=True, error_model="numpy")
def cover(screen, faces, height, width, bands):
    """1 where any face covers the pixel centre, else -1: (row, height, width) int8, no depth test."""
    rows = screen.shape[0]
    covered = np.empty((rows, height, width), np.int8)
    for task in prange(rows * bands):
        row, band = np.int64(task) // bands, np.int64(task) % bands
        start, stop = band * height // bands, (band + 1) * height // bands
        _cover_band(screen[row], faces, start, stop, covered[row])
    return covered
