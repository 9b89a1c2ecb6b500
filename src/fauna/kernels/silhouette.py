"""Numba kernels: where contours pass between neighbouring pixels. The rule is described in ``fauna.renderer.edges``.

A crossing is kept as four numbers: its cell, a flat index into (axis, height, width) of one image; its edge; its
offset; and the slope of its edge, d(position) / d(line).
"""

import math

import numpy as np
from numba import njit, prange

from fauna.kernels.raster import screen_position


@njit(cache=True, error_model="numpy")
def _is_front(clip, a, b, c):
    """Sign of the area on the screen, without division: the determinant of the corners' (X, Y, W)."""
    ax, ay, aw = np.float64(clip[a, 0]), np.float64(clip[a, 1]), np.float64(clip[a, 3])
    bx, by, bw = np.float64(clip[b, 0]), np.float64(clip[b, 1]), np.float64(clip[b, 3])
    cx, cy, cw = np.float64(clip[c, 0]), np.float64(clip[c, 1]), np.float64(clip[c, 3])
    return ax * (by * cw - bw * cy) - ay * (bx * cw - bw * cx) + aw * (bx * cy - by * cx) > 0.0


@njit(cache=True, error_model="numpy")
def _contours(clip, faces, edges, edge_faces, found):
    """Collect the edges between a front and a back face, and border edges."""
    front = np.empty(faces.shape[0], np.int8)
    for face in range(faces.shape[0]):
        front[face] = _is_front(clip, faces[face, 0], faces[face, 1], faces[face, 2])
    count = 0
    for edge in range(edges.shape[0]):
        second = edge_faces[edge, 1]
        found[count] = edge
        count += np.int64(second < 0) | np.int64(front[edge_faces[edge, 0]] != front[max(second, 0)])
    return count


@njit(cache=True, error_model="numpy")
def _offset(first_covered, second_covered, first_depth, second_depth, edge_depth, position, tolerance):
    """Place of the crossing after the first pixel if that is the inner one, else the same minus 1; NaN to reject."""
    first_inner = first_covered
    if first_covered == second_covered:
        if not first_covered or first_depth == second_depth:
            return np.nan
        first_inner = first_depth < second_depth
        if not edge_depth < max(first_depth, second_depth) - tolerance:
            return np.nan
    return position if first_inner else position - 1.0


@njit(cache=True, error_model="numpy")
def _cross_edge(start, end, axis, ids, depth, use_depth, tolerance, edge, slots, count, cell_of, edge_of, place_of):
    """Add the crossings of one edge with the lines of pixel centres: rows for axis 0, columns for axis 1."""
    height, width = ids.shape
    along, across = 1 - axis, axis
    lines, cells = (height, width) if axis == 0 else (width, height)
    delta = end[along] - start[along]
    if delta == 0.0:
        return count
    low, high = min(start[along], end[along]), max(start[along], end[along])
    first, stop = max(np.ceil(low), 0.0), min(np.ceil(high), np.float64(lines))
    if not first < stop:
        return count
    slope = (end[across] - start[across]) / delta
    for line in range(np.int64(first), np.int64(stop)):
        s = (line - start[along]) / delta
        position = start[across] + s * (end[across] - start[across])
        if not (position >= 0.0 and position < cells - 1):
            continue
        before = np.int64(position)
        i, j = (line, before) if axis == 0 else (before, line)
        k, m = (line, before + 1) if axis == 0 else (before + 1, line)
        near, far = 0.0, 0.0
        if use_depth:
            near, far = np.float64(depth[i, j]), np.float64(depth[k, m])
        edge_depth = start[2] + s * (end[2] - start[2])
        offset = _offset(ids[i, j] >= 0, ids[k, m] >= 0, near, far, edge_depth, position - before, tolerance)
        if math.isnan(offset):
            continue
        cell = (axis * height + i) * width + j
        slot = slots[cell]
        if slot < 0:
            slot = count
            slots[cell] = slot
            count += 1
        elif abs(offset) <= abs(place_of[slot, 0]):
            continue
        cell_of[slot], edge_of[slot], place_of[slot, 0], place_of[slot, 1] = cell, edge, offset, slope
    return count


@njit(cache=True, error_model="numpy")
def _cross_image(clip, faces, edges, edge_faces, ids, depth, use_depth, tolerance, cell_of, edge_of, place_of):
    """Crossings of one image, at most one for each pair of pixels: the outermost, the first of equals."""
    height, width = ids.shape
    slots = np.empty(2 * height * width, np.int32)
    slots[:] = -1
    found = np.empty(edges.shape[0] + 1, np.int32)
    count = 0
    for k in range(_contours(clip, faces, edges, edge_faces, found)):
        edge = found[k]
        start = screen_position(clip, edges[edge, 0], height, width)
        end = screen_position(clip, edges[edge, 1], height, width)
        if math.isnan(start[0]) or math.isnan(end[0]):
            continue
        for axis in range(2):
            count = _cross_edge(
                start, end, axis, ids, depth, use_depth, tolerance, edge, slots, count, cell_of, edge_of, place_of
            )
    return count


@njit(cache=True, error_model="numpy")
def _join(starts, cells, owners, places):
    """The used parts of the images' lists one after the other."""
    count = starts[-1]
    cell, edge, place = np.empty(count, np.int32), np.empty(count, np.int32), np.empty((count, 2), np.float64)
    for row in range(starts.shape[0] - 1):
        for k in range(starts[row + 1] - starts[row]):
            to = starts[row] + k
            cell[to], edge[to] = cells[row, k], owners[row, k]
            place[to, 0], place[to, 1] = places[row, k, 0], places[row, k, 1]
    return cell, edge, place


@njit(cache=True, parallel=True, error_model="numpy")
def find_crossings(clip, faces, edges, edge_faces, ids, depth, use_depth, tolerance):
    """Crossings of all images in the order (image, edge first met): (starts (row + 1), cell, edge, place).

    ``place`` (crossing, 2) holds offset and slope. ``ids`` is negative on background; without ``use_depth`` only
    pairs with one covered pixel count and ``depth`` is not read.
    """
    rows, height, width = ids.shape
    most = 2 * height * width
    cells, owners = np.empty((rows, most), np.int32), np.empty((rows, most), np.int32)  # pages not reached cost nothing
    places = np.empty((rows, most, 2), np.float64)
    counts = np.empty(rows, np.int64)
    for row in prange(rows):
        counts[row] = _cross_image(
            clip[row], faces, edges, edge_faces, ids[row], depth[min(np.int64(row), depth.shape[0] - 1)],
            use_depth, tolerance, cells[row], owners[row], places[row],
        )  # fmt: skip
    starts = np.zeros(rows + 1, np.int64)
    for row in range(rows):
        starts[row + 1] = starts[row] + counts[row]
    cell, edge, place = _join(starts, cells, owners, places)
    return starts, cell, edge, place
