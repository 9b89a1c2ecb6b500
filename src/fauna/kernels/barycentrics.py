"""Numba kernels: perspective-correct barycentrics and their gradient to the clip positions.

Gradients are summed per image by one thread, in pixel order: bitwise reproducible with any number of threads.
"""

import numpy as np
from numba import njit, prange


@njit(cache=True, error_model="numpy")
def _point(clip, vert, fx, fy):
    """(X - fx W, Y - fy W) of a vertex: where it is seen from NDC (fx, fy)."""
    w = np.float64(clip[vert, 3])
    return np.float64(clip[vert, 0]) - fx * w, np.float64(clip[vert, 1]) - fy * w


@njit(cache=True, error_model="numpy")
def fill_rows(clip, faces, ids, start, stop, out):
    """Barycentrics (height, width, 3) of one image at the pixel rows [start, stop), 0 on background."""
    height, width = ids.shape
    for i in range(start, stop):
        fy = (2 * i + 1) / height - 1.0
        out[i] = 0.0
        for j in range(width):
            face = ids[i, j]
            if face < 0:
                continue
            fx = (2 * j + 1) / width - 1.0
            px, py = _point(clip, faces[face, 0], fx, fy)
            qx, qy = _point(clip, faces[face, 1], fx, fy)
            rx, ry = _point(clip, faces[face, 2], fx, fy)
            e0, e1, e2 = qx * ry - qy * rx, rx * py - ry * px, px * qy - py * qx
            total = e0 + e1 + e2
            if total == 0.0:
                out[i, j] = 1.0 / 3.0
                continue
            scale = 1.0 / total
            out[i, j, 0] = e0 * scale
            out[i, j, 1] = e1 * scale
            out[i, j, 2] = e2 * scale


@njit(cache=True, error_model="numpy")
def _backward_image(clip, faces, ids, grad, grad_clip):
    height, width = ids.shape
    grad_clip[:] = 0.0
    for i in range(height):
        fy = (2 * i + 1) / height - 1.0
        for j in range(width):
            face = ids[i, j]
            if face < 0:
                continue
            g0, g1, g2 = np.float64(grad[i, j, 0]), np.float64(grad[i, j, 1]), np.float64(grad[i, j, 2])
            if g0 == 0.0 and g1 == 0.0 and g2 == 0.0:
                continue
            fx = (2 * j + 1) / width - 1.0
            a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
            px, py = _point(clip, a, fx, fy)
            qx, qy = _point(clip, b, fx, fy)
            rx, ry = _point(clip, c, fx, fy)
            e0, e1, e2 = qx * ry - qy * rx, rx * py - ry * px, px * qy - py * qx
            total = e0 + e1 + e2
            if total == 0.0:
                continue
            scale = 1.0 / total
            mean = (g0 * e0 + g1 * e1 + g2 * e2) * scale
            h0, h1, h2 = (g0 - mean) * scale, (g1 - mean) * scale, (g2 - mean) * scale
            _add(grad_clip, a, h2 * qy - h1 * ry, h1 * rx - h2 * qx, fx, fy)  # a corner enters the other two's
            _add(grad_clip, b, h0 * ry - h2 * py, h2 * px - h0 * rx, fx, fy)
            _add(grad_clip, c, h1 * py - h0 * qy, h0 * qx - h1 * px, fx, fy)


@njit(cache=True, error_model="numpy")
def _add(grad_clip, vert, gx, gy, fx, fy):
    """Add the gradient of a vertex from that of its ``_point``."""
    grad_clip[vert, 0] += gx
    grad_clip[vert, 1] += gy
    grad_clip[vert, 3] -= fx * gx + fy * gy


@njit(cache=True, parallel=True, error_model="numpy")
def backward(clip, faces, ids, grad):
    """Gradient (row, vert, 4) of the clip positions from that of the barycentrics (row, height, width, 3)."""
    grad_clip = np.empty(clip.shape, clip.dtype)
    for row in prange(ids.shape[0]):
        _backward_image(clip[row], faces, ids[row], grad[row], grad_clip[row])
    return grad_clip
