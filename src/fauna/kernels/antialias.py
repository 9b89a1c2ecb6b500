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


@njit(cache=True, error_model="numpy")
def _copy(source, target):
    """Plain loops compile several times faster than the assignment of slices."""
    for channel in range(source.shape[0]):
        for pixel in range(source.shape[1]):
            target[channel, pixel] = source[channel, pixel]


@njit(cache=True, error_model="numpy")
def _blend_image(image, height, width, cell, place, out):
    _copy(image, out)
    for k in range(cell.shape[0]):
        _, inner, outer = _pair(cell[k], place[k, 0], height, width)
        loss, gain, _, _ = _shares(place[k])
        for channel in range(image.shape[0]):
            step = image[channel, outer] - image[channel, inner]
            out[channel, inner] += loss * step
            out[channel, outer] -= gain * step


@njit(cache=True, parallel=True, error_model="numpy")
def blend(image, height, width, starts, cell, place):
    """Blended copy of ``image`` (row, chan, pixel)."""
    out = np.empty(image.shape, image.dtype)
    for row in prange(image.shape[0]):
        own = slice(starts[row], starts[row + 1])
        _blend_image(image[row], height, width, cell[own], place[own], out[row])
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


@njit(cache=True, error_model="numpy")
def _blend_image_backward(image, clip, edges, height, width, cell, edge, place, grad, grad_image, grad_clip):
    _copy(grad, grad_image)
    grad_clip[:] = 0.0
    for k in range(cell.shape[0]):
        axis, inner, outer = _pair(cell[k], place[k, 0], height, width)
        loss, gain, loss_rate, gain_rate = _shares(place[k])
        total = 0.0
        for channel in range(image.shape[0]):
            g_inner, g_outer = grad[channel, inner], grad[channel, outer]
            total += (loss_rate * g_inner - gain_rate * g_outer) * (image[channel, outer] - image[channel, inner])
            moved = loss * g_inner - gain * g_outer
            grad_image[channel, inner] -= moved
            grad_image[channel, outer] += moved
        _to_ends(clip, edges, edge[k], axis, cell[k], place[k], height, width, total, grad_clip)


@njit(cache=True, parallel=True, error_model="numpy")
def blend_backward(image, clip, edges, height, width, starts, cell, edge, place, grad):
    """Gradients of the image (row, chan, pixel) and of the clip positions (row, vert, 4); the slope carries none."""
    grad_image, grad_clip = np.empty(image.shape, image.dtype), np.empty(clip.shape, clip.dtype)
    for row in prange(image.shape[0]):
        own = slice(starts[row], starts[row + 1])
        _blend_image_backward(
            image[row], clip[row], edges, height, width, cell[own], edge[own], place[own],
            grad[row], grad_image[row], grad_clip[row],
        )  # fmt: skip
    return grad_image, grad_clip


@njit(cache=True, error_model="numpy")
def _cover_image(covered, height, width, cell, place, raw, out):
    for pixel in range(height * width):
        raw[pixel] = 1.0 if covered[pixel] >= 0 else 0.0
    for k in range(cell.shape[0]):
        _, inner, outer = _pair(cell[k], place[k, 0], height, width)
        loss, gain, _, _ = _shares(place[k])
        raw[inner] -= loss
        raw[outer] += gain
    for pixel in range(height * width):
        out[pixel] = min(max(raw[pixel], 0.0), 1.0)


@njit(cache=True, parallel=True, error_model="numpy")
def coverage(covered, like, starts, cell, place):
    """Antialiased coverage (row, pixel) not yet clamped, and the same clamped to [0, 1]; of the type of ``like``."""
    rows, height, width = covered.shape
    flat = covered.reshape(rows, height * width)
    raw, out = np.empty(flat.shape, like.dtype), np.empty(flat.shape, like.dtype)
    for row in prange(rows):
        own = slice(starts[row], starts[row + 1])
        _cover_image(flat[row], height, width, cell[own], place[own], raw[row], out[row])
    return raw, out


@njit(cache=True, error_model="numpy")
def _cover_image_backward(raw, clip, edges, height, width, cell, edge, place, grad, grad_clip):
    grad_clip[:] = 0.0
    for k in range(cell.shape[0]):
        axis, inner, outer = _pair(cell[k], place[k, 0], height, width)
        _, _, loss_rate, gain_rate = _shares(place[k])
        total = 0.0
        if 0.0 <= raw[inner] <= 1.0:
            total -= loss_rate * grad[inner]
        if 0.0 <= raw[outer] <= 1.0:
            total += gain_rate * grad[outer]
        _to_ends(clip, edges, edge[k], axis, cell[k], place[k], height, width, total, grad_clip)


@njit(cache=True, parallel=True, error_model="numpy")
def coverage_backward(raw, clip, edges, height, width, starts, cell, edge, place, grad):
    """Gradient of the clip positions (row, vert, 4) from that of the clamped coverage (row, pixel)."""
    grad_clip = np.empty(clip.shape, clip.dtype)
    for row in prange(raw.shape[0]):
        own = slice(starts[row], starts[row + 1])
        _cover_image_backward(
            raw[row], clip[row], edges, height, width, cell[own], edge[own], place[own], grad[row], grad_clip[row]
        )
    return grad_clip
