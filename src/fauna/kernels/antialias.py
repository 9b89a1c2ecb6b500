"""Numba kernels: blending of pixel pairs across contours, and its gradients; see ``fauna.renderer.edges``."""

import numpy as np
from numba import njit, prange


@njit(cache=True, error_model="numpy")
def beyond(distance, slope):
    """Part of a pixel beyond a line at ``distance`` >= 0 from its centre, and its derivative; ``slope`` in [0, 1]."""
    near, far = 0.5 * (1.0 - slope), 0.5 * (1.0 + slope)
    if distance <= near:
        return 0.5 - distance, -1.0
    if distance >= far:
        return 0.0, 0.0
    return 0.5 * (far - distance) ** 2 / slope, (distance - far) / slope


@njit(cache=True, error_model="numpy")
def _pair(cell, offset, height, width):
    """Axis, and the flat indices of the inner and the outer pixel of a crossing."""
    axis, first = cell // (height * width), cell % (height * width)
    second = first + (1 if axis == 0 else width)
    return (axis, first, second) if offset >= 0.0 else (axis, second, first)


@njit(cache=True, error_model="numpy")
def _shares(place):
    """What the inner pixel takes of the outer and the outer of the inner, and the derivatives by the distance."""
    offset, slope = place[0], abs(place[1])
    weight = 1.0 / (1.0 + slope**4)
    loss, loss_rate = beyond(abs(offset), min(slope, 1.0))
    gain, gain_rate = beyond(1.0 - abs(offset), min(slope, 1.0))
    return weight * loss, weight * gain, weight * loss_rate, -weight * gain_rate


@njit(cache=True, parallel=True, error_model="numpy")
def blend(image, height, width, starts, cell, place):
    """Blended copy of ``image`` (row, chan, pixel)."""
    out = np.empty(image.shape, image.dtype)
    for row in prange(image.shape[0]):
        out[row] = image[row]
        for k in range(starts[row], starts[row + 1]):
            _, inner, outer = _pair(cell[k], place[k, 0], height, width)
            loss, gain, _, _ = _shares(place[k])
            for channel in range(image.shape[1]):
                step = image[row, channel, outer] - image[row, channel, inner]
                out[row, channel, inner] += loss * step
                out[row, channel, outer] -= gain * step
    return out


@njit(cache=True, error_model="numpy")
def _to_ends(clip, edges, edge, axis, cell, place, height, width, grad_distance, grad_clip):
    """Gradient of an edge's ends from that of the distance between the inner pixel and the crossing."""
    line = (cell // width) % height if axis == 0 else cell % width
    grad = grad_distance if place[0] >= 0.0 else -grad_distance
    a, b = edges[edge, 0], edges[edge, 1]
    along, across = 1 - axis, axis
    half = 0.5 * (height if axis == 0 else width)
    begin = (np.float64(clip[a, along]) / np.float64(clip[a, 3]) + 1.0) * half - 0.5
    end = (np.float64(clip[b, along]) / np.float64(clip[b, 3]) + 1.0) * half - 0.5
    s = (line - begin) / (end - begin)
    for vert, share in ((a, 1.0 - s), (b, s)):
        w = np.float64(clip[vert, 3])
        g_across = grad * share * 0.5 * (width if axis == 0 else height) / w
        g_along = -grad * share * place[1] * half / w
        grad_clip[vert, across] += g_across
        grad_clip[vert, along] += g_along
        grad_clip[vert, 3] -= (g_across * clip[vert, across] + g_along * clip[vert, along]) / w


@njit(cache=True, parallel=True, error_model="numpy")
def blend_backward(image, clip, edges, height, width, starts, cell, edge, place, grad):
    """Gradients of the image (row, chan, pixel) and of the clip positions (row, vert, 4); the slope carries none."""
    grad_image, grad_clip = np.empty(image.shape, image.dtype), np.empty(clip.shape, clip.dtype)
    for row in prange(image.shape[0]):
        grad_image[row] = grad[row]
        grad_clip[row] = 0.0
        for k in range(starts[row], starts[row + 1]):
            axis, inner, outer = _pair(cell[k], place[k, 0], height, width)
            loss, gain, loss_rate, gain_rate = _shares(place[k])
            total = 0.0
            for channel in range(image.shape[1]):
                g_inner, g_outer = grad[row, channel, inner], grad[row, channel, outer]
                step = image[row, channel, outer] - image[row, channel, inner]
                total += (loss_rate * g_inner - gain_rate * g_outer) * step
                moved = loss * g_inner - gain * g_outer
                grad_image[row, channel, inner] -= moved
                grad_image[row, channel, outer] += moved
            _to_ends(clip[row], edges, edge[k], axis, cell[k], place[k], height, width, total, grad_clip[row])
    return grad_image, grad_clip


@njit(cache=True, parallel=True, error_model="numpy")
def coverage(covered, dtype_of, starts, cell, place):
    """Antialiased coverage (row, height, width) not yet clamped, and the same clamped to [0, 1]."""
    rows, height, width = covered.shape
    raw = np.empty((rows, height * width), dtype_of.dtype)
    out = np.empty((rows, height * width), dtype_of.dtype)
    for row in prange(rows):
        flat = covered[row].reshape(-1)
        for pixel in range(height * width):
            raw[row, pixel] = 1.0 if flat[pixel] >= 0 else 0.0
        for k in range(starts[row], starts[row + 1]):
            _, inner, outer = _pair(cell[k], place[k, 0], height, width)
            loss, gain, _, _ = _shares(place[k])
            raw[row, inner] -= loss
            raw[row, outer] += gain
        for pixel in range(height * width):
            out[row, pixel] = min(max(raw[row, pixel], 0.0), 1.0)
    return raw, out


@njit(cache=True, parallel=True, error_model="numpy")
def coverage_backward(raw, clip, edges, height, width, starts, cell, edge, place, grad):
    """Gradient of the clip positions (row, vert, 4) from that of the clamped coverage (row, pixel)."""
    grad_clip = np.empty(clip.shape, clip.dtype)
    for row in prange(raw.shape[0]):
        grad_clip[row] = 0.0
        for k in range(starts[row], starts[row + 1]):
            axis, inner, outer = _pair(cell[k], place[k, 0], height, width)
            _, _, loss_rate, gain_rate = _shares(place[k])
            total = 0.0
            if raw[row, inner] >= 0.0 and raw[row, inner] <= 1.0:
                total -= loss_rate * grad[row, inner]
            if raw[row, outer] >= 0.0 and raw[row, outer] <= 1.0:
                total += gain_rate * grad[row, outer]
            _to_ends(clip[row], edges, edge[k], axis, cell[k], place[k], height, width, total, grad_clip[row])
    return grad_clip
