"""Numba kernels: what neighbouring pixels take of each other across contours, for lists of pixels."""

import numpy as np
from numba import njit, prange

from fauna.kernels.antialias import _pair, _shares, _to_ends


@njit(cache=True, parallel=True, error_model="numpy")
def transfers(height, width, starts, cell, place):
    """(target, source, share) of two transfers per crossing: the inner pixel takes of the outer, and the reverse."""
    count = cell.shape[0]
    target, source = np.empty(2 * count, np.int64), np.empty(2 * count, np.int64)
    share = np.empty(2 * count, np.float64)
    for row in prange(starts.shape[0] - 1):
        first = np.int64(row) * height * width
        for k in range(starts[row], starts[row + 1]):
            _, inner, outer = _pair(cell[k], place[k, 0], height, width)
            loss, gain, _, _ = _shares(place[k])
            target[k], source[k], share[k] = first + inner, first + outer, loss
            target[count + k], source[count + k], share[count + k] = first + outer, first + inner, gain
    return target, source, share


@njit(cache=True, parallel=True, error_model="numpy")
def transfers_backward(clip, edges, height, width, starts, cell, edge, place, grad):
    """Gradient of the clip positions (row, vert, 4) from that of the shares; the slope carries none."""
    grad_clip = np.zeros(clip.shape, clip.dtype)
    count = cell.shape[0]
    for row in prange(starts.shape[0] - 1):
        for k in range(starts[row], starts[row + 1]):
            axis, _, _ = _pair(cell[k], place[k, 0], height, width)
            _, _, loss_rate, gain_rate = _shares(place[k])
            total = loss_rate * grad[k] + gain_rate * grad[count + k]
            _to_ends(clip[row], edges, edge[k], axis, cell[k], place[k], height, width, total, grad_clip[row])
    return grad_clip
