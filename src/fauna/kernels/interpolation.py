"""Numba kernels: interpolation of vertex attributes and its gradients.

``pixel`` is a flat index into one image (height * width). Gradients are summed per image by one thread, in pixel
order: bitwise reproducible with any number of threads.
"""

import numpy as np
from numba import njit, prange

TILE = 512  # pixels whose channels stay in the first-level cache between clearing and filling


@njit(cache=True, error_model="numpy")
def _image(attributes, faces, ids, bary, out):
    channels, size = out.shape
    for start in range(0, size, TILE):
        stop = min(start + TILE, size)
        for channel in range(channels):
            out[channel, start:stop] = 0.0
        for pixel in range(start, stop):
            face = ids[pixel]
            if face < 0:
                continue
            a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
            b0, b1, b2 = bary[pixel, 0], bary[pixel, 1], bary[pixel, 2]
            for channel in range(channels):
                out[channel, pixel] = (
                    b0 * attributes[a, channel] + b1 * attributes[b, channel] + b2 * attributes[c, channel]
                )


@njit(cache=True, parallel=True, error_model="numpy")
def interpolate(attributes, faces, ids, bary):
    """(row, chan, pixel) image of (row or 1, vert, chan) attributes; ids (row, pixel), bary (row, pixel, 3)."""
    rows, size = ids.shape
    out = np.empty((rows, attributes.shape[2], size), attributes.dtype)
    for row in prange(rows):
        source = attributes[min(np.int64(row), attributes.shape[0] - 1)]
        _image(source, faces, ids[row], bary[row], out[row])
    return out


@njit(cache=True, error_model="numpy", inline="always")
def _pixel_backward(attributes, faces, face, bary, pixel, grad, column, grad_attributes):
    """Gradient of a pixel's barycentrics, given ``grad[:, column]``; adds to that of its corners.

    Takes whole arrays: making slices of them for each pixel would cost as much again.
    """
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    b0, b1, b2 = bary[pixel, 0], bary[pixel, 1], bary[pixel, 2]
    s0 = s1 = s2 = 0.0 * b0
    for channel in range(grad.shape[0]):
        g = grad[channel, column]
        s0 += g * attributes[a, channel]
        s1 += g * attributes[b, channel]
        s2 += g * attributes[c, channel]
        grad_attributes[a, channel] += b0 * g
        grad_attributes[b, channel] += b1 * g
        grad_attributes[c, channel] += b2 * g
    return s0, s1, s2


@njit(cache=True, error_model="numpy")
def _image_backward(attributes, faces, ids, bary, grad, grad_attributes, grad_bary):
    grad_attributes[:] = 0.0
    for pixel in range(ids.shape[0]):
        s0 = s1 = s2 = 0.0 * bary[pixel, 0]
        if ids[pixel] >= 0:
            s0, s1, s2 = _pixel_backward(attributes, faces, ids[pixel], bary, pixel, grad, pixel, grad_attributes)
        grad_bary[pixel, 0], grad_bary[pixel, 1], grad_bary[pixel, 2] = s0, s1, s2


@njit(cache=True, parallel=True, error_model="numpy")
def interpolate_backward(attributes, faces, ids, bary, grad):
    """Gradients (row, vert, chan) of the attributes, one per image even when shared, and of the barycentrics.

    ``grad`` (row, chan, pixel) may have any strides.
    """
    rows, size = ids.shape
    grad_attributes = np.empty((rows, attributes.shape[1], attributes.shape[2]), attributes.dtype)
    grad_bary = np.empty(bary.shape, bary.dtype)
    for row in prange(rows):
        source = attributes[min(np.int64(row), attributes.shape[0] - 1)]
        _image_backward(source, faces, ids[row], bary[row], grad[row], grad_attributes[row], grad_bary[row])
    return grad_attributes, grad_bary


@njit(cache=True, error_model="numpy")
def _at(attributes, source, faces, face, bary, pixel, out, k):
    for channel in range(out.shape[1]):
        out[k, channel] = 0.0
    if face < 0:
        return
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    b0, b1, b2 = bary[pixel, 0], bary[pixel, 1], bary[pixel, 2]
    for channel in range(out.shape[1]):
        out[k, channel] = (
            b0 * attributes[source, a, channel]
            + b1 * attributes[source, b, channel]
            + b2 * attributes[source, c, channel]
        )


@njit(cache=True, parallel=True, error_model="numpy")
def interpolate_at(attributes, faces, ids, bary, pixels):
    """(entry, chan) attributes at a list of flat indices into (row, pixel)."""
    size = ids.shape[1]
    flat_ids, flat_bary = ids.reshape(-1), bary.reshape(-1, 3)
    out = np.empty((pixels.shape[0], attributes.shape[2]), attributes.dtype)
    for k in prange(pixels.shape[0]):
        pixel = np.int64(pixels[k])
        source = min(pixel // size, attributes.shape[0] - 1)
        _at(attributes, source, faces, flat_ids[pixel], flat_bary, pixel, out, np.int64(k))
    return out


@njit(cache=True, error_model="numpy")
def _sort_by_row(pixels, rows, size):
    """Entries of the list ordered by image, stable, and where each image's begin (row + 1)."""
    starts = np.zeros(rows + 1, np.int64)
    for k in range(pixels.shape[0]):
        starts[pixels[k] // size + 1] += 1
    for row in range(rows):
        starts[row + 1] += starts[row]
    fill, order = starts[:-1].copy(), np.empty(pixels.shape[0], np.int64)
    for k in range(pixels.shape[0]):
        row = pixels[k] // size
        order[fill[row]] = k
        fill[row] += 1
    return order, starts


@njit(cache=True, error_model="numpy")
def _list_backward(attributes, faces, ids, bary, pixels, first, own, grad, grad_attributes, grad_bary):
    grad_attributes[:] = 0.0
    grad_bary[:] = 0.0
    for k in own:
        pixel = pixels[k] - first
        if ids[pixel] >= 0:
            s0, s1, s2 = _pixel_backward(attributes, faces, ids[pixel], bary, pixel, grad, k, grad_attributes)
            grad_bary[pixel, 0] += s0
            grad_bary[pixel, 1] += s1
            grad_bary[pixel, 2] += s2


@njit(cache=True, parallel=True, error_model="numpy")
def interpolate_at_backward(attributes, faces, ids, bary, pixels, grad):
    """As ``interpolate_backward`` for ``interpolate_at``; ``grad`` (entry, chan). A pixel may be listed repeatedly."""
    rows, size = ids.shape
    order, starts = _sort_by_row(pixels, rows, size)
    by_channel = grad.T
    grad_attributes = np.empty((rows, attributes.shape[1], attributes.shape[2]), attributes.dtype)
    grad_bary = np.empty(bary.shape, bary.dtype)
    for row in prange(rows):
        source = attributes[min(np.int64(row), attributes.shape[0] - 1)]
        own, first = order[starts[row] : starts[row + 1]], np.int64(row) * size
        _list_backward(
            source, faces, ids[row], bary[row], pixels, first, own, by_channel, grad_attributes[row], grad_bary[row]
        )
    return grad_attributes, grad_bary
