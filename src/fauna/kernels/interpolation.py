"""Numba kernels: perspective-correct barycentrics, attribute interpolation, and their gradients.

Gradients are summed per image by one thread, in pixel order: bitwise reproducible with any number of threads.
"""

import numpy as np
from numba import njit, prange


@njit(cache=True, inline="always")
def _edge_functions(clip, corner, fx, fy, point):
    """Homogeneous 2-D edge functions of a triangle at NDC (fx, fy); fills point (3, 2) with (X - fx W, Y - fy W)."""
    for k in range(3):
        w = np.float64(clip[corner[k], 3])
        point[k, 0] = np.float64(clip[corner[k], 0]) - fx * w
        point[k, 1] = np.float64(clip[corner[k], 1]) - fy * w
    e0 = point[1, 0] * point[2, 1] - point[1, 1] * point[2, 0]
    e1 = point[2, 0] * point[0, 1] - point[2, 1] * point[0, 0]
    e2 = point[0, 0] * point[1, 1] - point[0, 1] * point[1, 0]
    return e0, e1, e2


@njit(cache=True)
def _barycentrics_image(clip, faces, ids, out):
    height, width = ids.shape
    point = np.empty((3, 2))
    for i in range(height):
        fy = (2 * i + 1) / height - 1.0
        for j in range(width):
            face = ids[i, j]
            if face < 0:
                out[i, j] = 0.0
                continue
            e0, e1, e2 = _edge_functions(clip, faces[face], (2 * j + 1) / width - 1.0, fy, point)
            total = e0 + e1 + e2
            if total == 0.0:
                out[i, j] = 1.0 / 3.0
                continue
            out[i, j, 0] = e0 / total
            out[i, j, 1] = e1 / total
            out[i, j, 2] = e2 / total


@njit(cache=True, parallel=True)
def barycentrics(clip, faces, ids):
    """(row, height, width, 3) barycentrics at the pixel centres, 0 on background."""
    out = np.empty((*ids.shape, 3), clip.dtype)
    for row in prange(ids.shape[0]):
        _barycentrics_image(clip[row], faces, ids[row], out[row])
    return out


@njit(cache=True)
def _barycentrics_image_backward(clip, faces, ids, grad, grad_clip):
    height, width = ids.shape
    point = np.empty((3, 2))
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
            e0, e1, e2 = _edge_functions(clip, faces[face], fx, fy, point)
            total = e0 + e1 + e2
            if total == 0.0:
                continue
            mean = (g0 * e0 + g1 * e1 + g2 * e2) / total
            h = ((g0 - mean) / total, (g1 - mean) / total, (g2 - mean) / total)
            for k in range(3):  # corner k enters the edge functions of the two other corners
                p, q = (k + 1) % 3, (k + 2) % 3
                gx = h[q] * point[p, 1] - h[p] * point[q, 1]
                gy = h[p] * point[q, 0] - h[q] * point[p, 0]
                vert = faces[face, k]
                grad_clip[vert, 0] += gx
                grad_clip[vert, 1] += gy
                grad_clip[vert, 3] -= fx * gx + fy * gy


@njit(cache=True, parallel=True)
def barycentrics_backward(clip, faces, ids, grad):
    """Gradient (row, vert, 4) of the clip positions from that of the barycentrics."""
    grad_clip = np.zeros(clip.shape, clip.dtype)
    for row in prange(ids.shape[0]):
        _barycentrics_image_backward(clip[row], faces, ids[row], grad[row], grad_clip[row])
    return grad_clip


@njit(cache=True)
def _interpolate_image(attributes, faces, ids, bary, out):
    channels = attributes.shape[1]
    for pixel in range(ids.shape[0]):
        face = ids[pixel]
        if face < 0:
            for channel in range(channels):
                out[channel, pixel] = 0.0
            continue
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        b0, b1, b2 = bary[pixel, 0], bary[pixel, 1], bary[pixel, 2]
        for channel in range(channels):
            out[channel, pixel] = (
                b0 * attributes[a, channel] + b1 * attributes[b, channel] + b2 * attributes[c, channel]
            )


@njit(cache=True, parallel=True)
def interpolate(attributes, faces, ids, bary):
    """(row, chan, pixel) image of (row or 1, vert, chan) attributes; ids (row, pixel), bary (row, pixel, 3)."""
    rows, pixels = ids.shape
    out = np.empty((rows, attributes.shape[2], pixels), attributes.dtype)
    for row in prange(rows):
        _interpolate_image(
            attributes[min(np.int64(row), attributes.shape[0] - 1)], faces, ids[row], bary[row], out[row]
        )
    return out


@njit(cache=True)
def _interpolate_image_backward(attributes, faces, ids, bary, grad, grad_attributes, grad_bary):
    channels = attributes.shape[1]
    for pixel in range(ids.shape[0]):
        face = ids[pixel]
        if face < 0:
            continue
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        b0, b1, b2 = bary[pixel, 0], bary[pixel, 1], bary[pixel, 2]
        for channel in range(channels):
            g = grad[channel, pixel]
            grad_attributes[a, channel] += b0 * g
            grad_attributes[b, channel] += b1 * g
            grad_attributes[c, channel] += b2 * g
            grad_bary[pixel, 0] += g * attributes[a, channel]
            grad_bary[pixel, 1] += g * attributes[b, channel]
            grad_bary[pixel, 2] += g * attributes[c, channel]


@njit(cache=True, parallel=True)
def interpolate_backward(attributes, faces, ids, bary, grad):
    """Gradients (row, vert, chan) of the attributes, one per image even when shared, and of the barycentrics."""
    rows = ids.shape[0]
    grad_attributes = np.zeros((rows, attributes.shape[1], attributes.shape[2]), attributes.dtype)
    grad_bary = np.zeros(bary.shape, bary.dtype)
    for row in prange(rows):
        source = attributes[min(np.int64(row), attributes.shape[0] - 1)]
        _interpolate_image_backward(source, faces, ids[row], bary[row], grad[row], grad_attributes[row], grad_bary[row])
    return grad_attributes, grad_bary


@njit(cache=True, parallel=True)
def interpolate_at(attributes, faces, ids, bary, pixels):
    """(pixel, chan) attributes at flat pixel indices into (row * image size)."""
    size = ids.shape[1]
    flat_ids, flat_bary = ids.reshape(-1), bary.reshape(-1, 3)
    out = np.empty((pixels.shape[0], attributes.shape[2]), attributes.dtype)
    for k in prange(pixels.shape[0]):
        pixel = np.int64(pixels[k])
        face = flat_ids[pixel]
        source = min(pixel // size, attributes.shape[0] - 1)
        for channel in range(attributes.shape[2]):
            value = 0.0 * flat_bary[pixel, 0]
            if face >= 0:
                for corner in range(3):
                    value += flat_bary[pixel, corner] * attributes[source, faces[face, corner], channel]
            out[k, channel] = value
    return out


@njit(cache=True, parallel=True)
def interpolate_at_backward(attributes, faces, ids, bary, pixels, grad):
    """As ``interpolate_backward`` for ``interpolate_at``: every image's thread picks its own pixels from the list."""
    rows, size = ids.shape
    grad_attributes = np.zeros((rows, attributes.shape[1], attributes.shape[2]), attributes.dtype)
    grad_bary = np.zeros(bary.shape, bary.dtype)
    for row in prange(rows):
        source = min(np.int64(row), attributes.shape[0] - 1)
        for k in range(pixels.shape[0]):
            pixel = pixels[k] - np.int64(row) * size
            if pixel < 0 or pixel >= size or ids[row, pixel] < 0:
                continue
            for corner in range(3):
                vert = faces[ids[row, pixel], corner]
                weight = bary[row, pixel, corner]
                total = 0.0 * weight
                for channel in range(grad.shape[1]):
                    grad_attributes[row, vert, channel] += weight * grad[k, channel]
                    total += attributes[source, vert, channel] * grad[k, channel]
                grad_bary[row, pixel, corner] += total
    return grad_attributes, grad_bary
