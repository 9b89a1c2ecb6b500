"""Numba kernels: the integer work of the sparse extraction on the marks of ``fauna.geometry.bricks``.

Each is the loop that a dozen torch operations of the caller spell out, with equal results. ``grid`` holds the cells
along the three axes of the lattice and then the bricks along them.
"""

import numpy as np
from numba import njit

from fauna.geometry.bricks import EDGE, POINTS


@njit(cache=True)
def _corner(table, grid, i, j, k):
    brick = table[(i // EDGE * grid[4] + j // EDGE) * grid[5] + k // EDGE]
    return brick * POINTS + (i % EDGE * EDGE + j % EDGE) * EDGE + k % EDGE


@njit(cache=True)
def _centre(table, grid, i, j, k):
    return _corner(table, grid, i, j, k) + POINTS // 2


@njit(cache=True)
def _in_box(grid, i, j, k):
    return 0 <= i < grid[0] and 0 <= j < grid[1] and 0 <= k < grid[2]


@njit(cache=True)
def survivors(blocks, values, size, reach, margin, grid):
    """(kept, 3) blocks of ``size`` cells that may hold a sign change: those near a zero, or inside at the border."""
    kept = np.empty_like(blocks)
    count = 0
    for row in range(blocks.shape[0]):
        value = values[row]
        keep = abs(value) <= reach + margin
        if not keep and value > -margin:
            for axis in range(3):
                keep |= (blocks[row, axis] + 1) * size >= grid[axis] or (axis > 0 and blocks[row, axis] == 0)
        if keep:
            kept[count] = blocks[row]
            count += 1
    return kept[:count].copy()


@njit(cache=True)
def children(blocks, size, grid):
    """(child, 3) the eight blocks of ``size`` cells inside each block, those beyond the box left out."""
    found = np.empty((8 * blocks.shape[0], 3), np.int64)
    count = 0
    for row in range(blocks.shape[0]):
        for child in range(8):
            i, j, k = 2 * blocks[row, 0], 2 * blocks[row, 1], 2 * blocks[row, 2]
            i, j, k = i + (child >> 2), j + (child >> 1 & 1), k + (child & 1)
            if _in_box(grid, i * size, j * size, k * size):
                found[count, 0], found[count, 1], found[count, 2] = i, j, k
                count += 1
    return found[:count].copy()


@njit(cache=True)
def mark_bricks(cells, wanted, grid):
    """Set ``wanted``, one mark per brick of the box, around the corners and neighbours of cells."""
    for row in range(cells.shape[0]):
        for sign in range(8):
            place = 0
            for axis in range(3):
                index = cells[row, axis] + 2 * (sign >> axis & 1) - 1
                place = place * grid[3 + axis] + min(max(index, 0), grid[axis]) // EDGE
            wanted[place] = True


@njit(cache=True)
def half_steps(numbers, origins):
    """(point, 3) coordinates of points in half cells."""
    steps = np.empty((numbers.shape[0], 3), np.int64)
    for row in range(numbers.shape[0]):
        brick, place = divmod(numbers[row], POINTS)
        centre, place = divmod(place, POINTS // 2)
        steps[row, 0] = 2 * (origins[brick, 0] + place // EDGE**2) + centre
        steps[row, 1] = 2 * (origins[brick, 1] + place // EDGE % EDGE) + centre
        steps[row, 2] = 2 * (origins[brick, 2] + place % EDGE) + centre
    return steps


@njit(cache=True)
def mark_surroundings(cells, wanted, table, grid):
    """Set ``wanted`` at the corners and the centre of cells and at the centres of their neighbours."""
    for row in range(cells.shape[0]):
        i, j, k = cells[row]
        for corner in range(8):
            wanted[_corner(table, grid, i + (corner >> 2), j + (corner >> 1 & 1), k + (corner & 1))] = True
        wanted[_centre(table, grid, i, j, k)] = True
        for axis in range(3):
            for step in (-1, 1):
                a, b, c = i + step * (axis == 0), j + step * (axis == 1), k + step * (axis == 2)
                if _in_box(grid, a, b, c):
                    wanted[_centre(table, grid, a, b, c)] = True


@njit(cache=True)
def mark_behind(cells, fresh, inside, active, table, grid, rings):
    """Set ``fresh`` at the centres of inactive neighbours that see the surface through their face to one of ``cells``.

    ``rings[axis]`` are the corners of the face at the low end of an axis.
    """
    for row in range(cells.shape[0]):
        i, j, k = cells[row]
        for axis in range(3):
            for side in range(2):
                step = 2 * side - 1
                a, b, c = i + step * (axis == 0), j + step * (axis == 1), k + step * (axis == 2)
                if not _in_box(grid, a, b, c):
                    continue
                number = _centre(table, grid, a, b, c)
                if active[number]:
                    continue
                count = int(inside[number])
                for ring in rings[axis]:
                    x, y, z = i + ring[0], j + ring[1], k + ring[2]
                    x, y, z = x + side * (axis == 0), y + side * (axis == 1), z + side * (axis == 2)
                    count += inside[_corner(table, grid, x, y, z)]
                if 0 < count < 5:
                    fresh[number] = True


@njit(cache=True)
def _face_points(points, table, grid, rings, i, j, k, axis, thickness):
    """Numbers of the centres on both sides of a cell's high face and of its ring; with ``thickness`` 0 its low face."""
    a, b, c = thickness * (axis == 0), thickness * (axis == 1), thickness * (axis == 2)
    points[0] = _centre(table, grid, i, j, k)
    points[1] = _centre(table, grid, i + a, j + b, k + c)
    for turn in range(4):
        x, y, z = rings[axis, turn, 0], rings[axis, turn, 1], rings[axis, turn, 2]
        points[2 + turn] = _corner(table, grid, i + a + x, j + b + y, k + c + z)


@njit(cache=True)
def _face_triangles(points, inside, mirrored, cases, pairs, inner, outer, count):
    """Append the triangles of the four tetrahedra of a face; ``points`` are its two centres and its ring."""
    total = 0
    for place in range(6):
        total += inside[points[place]]
    if total == 0 or total == 6:
        return count
    for turn in range(4):
        third, fourth = points[2 + turn], points[2 + (turn + 1) % 4]
        tet = (points[0], points[1], third, fourth)
        case = inside[tet[0]] + 2 * inside[tet[1]] + 4 * inside[third] + 8 * inside[fourth]
        for triangle in range(2):
            if cases[case, triangle, 0] < 0:
                break
            for vertex in range(3):
                edge = cases[case, triangle, vertex]
                first, second = tet[pairs[edge, 0]], tet[pairs[edge, 1]]
                if not inside[first]:
                    first, second = second, first
                inner[count] = first
                outer[count] = ~second if mirrored and 1 <= edge <= 2 else second  # from the centre's mirror image
                count += 1
    return count


@njit(cache=True)
def crossed_edges(cells, inside, active, table, grid, rings, cases, pairs):
    """Corners of all triangles around ``cells``, three by three, as the inner and outer ends of their edges.

    Those across the mirror plane come last, from the returned index on; there ``~outer`` stands for the mirror image of
    an edge.
    """
    inner, outer = np.empty(168 * cells.shape[0], np.int64), np.empty(168 * cells.shape[0], np.int64)
    points = np.empty(6, np.int64)
    count = 0
    for row in range(cells.shape[0]):
        for axis in range(3):
            for side in range(2):  # the cell's high face, then its low face where no active cell is behind it
                i, j, k = cells[row, 0], cells[row, 1], cells[row, 2]
                i, j, k = i - side * (axis == 0), j - side * (axis == 1), k - side * (axis == 2)
                if min(i, j, k) < 0 or cells[row, axis] + 1 - side >= grid[axis]:
                    continue
                if side and active[_centre(table, grid, i, j, k)]:
                    continue
                _face_points(points, table, grid, rings, i, j, k, axis, 1)
                count = _face_triangles(points, inside, False, cases, pairs, inner, outer, count)
    split = count
    for row in range(cells.shape[0]):
        if cells[row, 0] == 0:
            _face_points(points, table, grid, rings, 0, cells[row, 1], cells[row, 2], 0, 0)
            count = _face_triangles(points, inside, True, cases, pairs, inner, outer, count)
    return inner[:count], outer[:count], split


@njit(cache=True)
def number_edges(inner, outer, num_points):
    """Merge equal edges: (vert, 2) ends by (inner, outer) and the edge of each corner, plus ``vert`` at ``~outer``.

    Edges are put into the bucket of their inner end and sorted within it; buckets hold fourteen at most.
    """
    start = np.zeros(num_points + 1, np.int64)
    for corner in range(inner.shape[0]):
        start[inner[corner] + 1] += 1
    for point in range(num_points):
        start[point + 1] += start[point]
    used = np.zeros(num_points, np.int64)
    bucket = np.empty(inner.shape[0], np.int64)
    for corner in range(inner.shape[0]):
        point, end = inner[corner], max(outer[corner], ~outer[corner])
        low = start[point]
        slot = low + used[point]
        while slot > low and bucket[slot - 1] > end:
            slot -= 1
        if slot > low and bucket[slot - 1] == end:
            continue
        for other in range(low + used[point], slot, -1):
            bucket[other] = bucket[other - 1]
        bucket[slot] = end
        used[point] += 1
    return _ranks(inner, outer, start, used, bucket)


@njit(cache=True)
def _ranks(inner, outer, start, used, bucket):
    first = np.empty_like(used)
    count = 0
    for point in range(used.shape[0]):
        first[point] = count
        count += used[point]
    ends = np.empty((count, 2), np.int64)
    for point in range(used.shape[0]):
        for place in range(used[point]):
            ends[first[point] + place, 0] = point
            ends[first[point] + place, 1] = bucket[start[point] + place]
    vertex = np.empty_like(inner)
    for corner in range(inner.shape[0]):
        point, end = inner[corner], max(outer[corner], ~outer[corner])
        place = 0
        while bucket[start[point] + place] != end:
            place += 1
        vertex[corner] = first[point] + place + (count if outer[corner] < 0 else 0)
    return ends, vertex
