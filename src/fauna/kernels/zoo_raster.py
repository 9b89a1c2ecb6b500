"""Compiled loops of the zoo: implicit union of round cones, z-buffer, value noise. Single-threaded, hence deterministic."""

import math

import numba
import numpy as np


@numba.njit(cache=True, inline="always")
def _round_cone(px, py, pz, cone):
    """Signed distance (negative inside) to one cone row ``(ax, ay, az, bx, by, bz, ra, rb, x_scale)``.

    The x axis is stretched by ``1 / x_scale`` about the axis of the cone, which flattens the section.
    The closed form is the convex hull of two spheres: a sphere swept along the segment, its centre moved by the slope.
    """
    bx, by, bz = cone[3] - cone[0], cone[4] - cone[1], cone[5] - cone[2]
    qy, qz = py - cone[1], pz - cone[2]
    length2 = bx * bx + by * by + bz * bz
    ra, rb = cone[6], cone[7]
    # The section is scaled about the axis point at the same height, so that flat limbs stay centred on their bone.
    along = 0.0
    if length2 > 0.0:
        along = min(1.0, max(0.0, ((px - cone[0]) * bx + qy * by + qz * bz) / length2))
    axis_x = cone[0] + along * bx
    qx = axis_x - cone[0] + (px - axis_x) / cone[8]
    gap = ra - rb
    if length2 <= gap * gap:
        if ra >= rb:
            return math.sqrt(qx * qx + qy * qy + qz * qz) - ra
        qx, qy, qz = qx - bx, qy - by, qz - bz
        return math.sqrt(qx * qx + qy * qy + qz * qz) - rb
    length = math.sqrt(length2)
    height = (qx * bx + qy * by + qz * bz) / length
    radial = math.sqrt(max(0.0, qx * qx + qy * qy + qz * qz - height * height))
    slope = gap / length
    centre = height - radial * slope / math.sqrt(1.0 - slope * slope)
    centre = min(length, max(0.0, centre))
    offset = height - centre
    return math.sqrt(radial * radial + offset * offset) - (ra - slope * centre)


@numba.njit(cache=True)
def cone_distances(points, cones):
    """Signed distance of every point to every cone.

    Args:
        points: (point, 3) float64.
        cones: (cone, 9) float64 rows ``(a, b, radius_a, radius_b, x_scale)``.

    Returns:
        (point, cone) float64, negative inside.
    """
    out = np.empty((points.shape[0], cones.shape[0]))
    for i in range(points.shape[0]):
        for j in range(cones.shape[0]):
            out[i, j] = _round_cone(points[i, 0], points[i, 1], points[i, 2], cones[j])
    return out


@numba.njit(cache=True)
def union_field(field, origin, cell, cones, blends):
    """Smooth union, in place, of cones into a sampled distance field (negative inside).

    Each cone is evaluated in its bounding box only; ``min(a, b) - max(blend - |a - b|, 0)^2 / (4 blend)`` joins it.

    Args:
        field: (nx, ny, nz) float64, positive far value where nothing is yet.
        origin: (3,) position of sample (0, 0, 0).
        cell: spacing of the samples.
        cones: (cone, 9) as in :func:`cone_distances`.
        blends: (cone,) blending lengths, > 0.
    """
    low = np.zeros(3, np.int64)
    high = np.zeros(3, np.int64)
    for c in range(cones.shape[0]):
        cone = cones[c]
        margin = blends[c] + 3.0 * cell
        for axis in range(3):
            first = min(cone[axis] - cone[6], cone[axis + 3] - cone[7]) - margin - origin[axis]
            last = max(cone[axis] + cone[6], cone[axis + 3] + cone[7]) + margin - origin[axis]
            low[axis] = max(0, int(math.floor(first / cell)))
            high[axis] = min(field.shape[axis], int(math.ceil(last / cell)) + 1)
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                for k in range(low[2], high[2]):
                    near = _round_cone(origin[0] + i * cell, origin[1] + j * cell, origin[2] + k * cell, cone)
                    field[i, j, k] = smooth_min(field[i, j, k], near, blends[c])


@numba.njit(cache=True, inline="always")
def smooth_min(a, b, blend):
    """Quadratic smooth minimum of two scalars."""
    overlap = max(blend - abs(a - b), 0.0)
    return min(a, b) - overlap * overlap / (4.0 * blend)


@numba.njit(cache=True)
def merge_fields(field, other, blend):
    """Smooth union, in place, of two sampled fields of the same shape."""
    for i in range(field.shape[0]):
        for j in range(field.shape[1]):
            for k in range(field.shape[2]):
                field[i, j, k] = smooth_min(field[i, j, k], other[i, j, k], blend)


@numba.njit(cache=True)
def rasterise(clip, faces, height, width):
    """Nearest triangle through every pixel centre; triangles facing away or crossing the camera plane are skipped.

    Args:
        clip: (vert, 4) float64 homogeneous positions, NDC x right, y down.
        faces: (face, 3) int64, counter-clockwise seen from outside.
        height: rows.
        width: columns.

    Returns:
        face index (height, width) int64, -1 for background; perspective-correct barycentrics (height, width, 3);
        NDC depth z / w (height, width), +inf for background.
    """
    index = np.full((height, width), -1, np.int64)
    bary = np.zeros((height, width, 3))
    nearest = np.full((height, width), np.inf)
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        wa, wb, wc = clip[a, 3], clip[b, 3], clip[c, 3]
        if wa <= 1e-6 or wb <= 1e-6 or wc <= 1e-6:
            continue
        ax, ay = (clip[a, 0] / wa + 1.0) * 0.5 * width - 0.5, (clip[a, 1] / wa + 1.0) * 0.5 * height - 0.5
        bx, by = (clip[b, 0] / wb + 1.0) * 0.5 * width - 0.5, (clip[b, 1] / wb + 1.0) * 0.5 * height - 0.5
        cx, cy = (clip[c, 0] / wc + 1.0) * 0.5 * width - 0.5, (clip[c, 1] / wc + 1.0) * 0.5 * height - 0.5
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area >= -1e-12:  # y points down, so outward faces have negative area
            continue
        za, zb, zc = clip[a, 2] / wa, clip[b, 2] / wb, clip[c, 2] / wc
        first_row, last_row = max(0, int(math.ceil(min(ay, by, cy)))), min(height - 1, int(math.floor(max(ay, by, cy))))
        first_col, last_col = max(0, int(math.ceil(min(ax, bx, cx)))), min(width - 1, int(math.floor(max(ax, bx, cx))))
        for i in range(first_row, last_row + 1):
            for j in range(first_col, last_col + 1):
                u = ((bx - j) * (cy - i) - (by - i) * (cx - j)) / area
                v = ((cx - j) * (ay - i) - (cy - i) * (ax - j)) / area
                t = 1.0 - u - v
                if u < 0.0 or v < 0.0 or t < 0.0:
                    continue
                depth = u * za + v * zb + t * zc
                if depth >= nearest[i, j]:
                    continue
                nearest[i, j] = depth
                index[i, j] = f
                pu, pv, pt = u / wa, v / wb, t / wc
                total = pu + pv + pt
                bary[i, j, 0], bary[i, j, 1], bary[i, j, 2] = pu / total, pv / total, pt / total
    return index, bary, nearest


@numba.njit(cache=True, inline="always")
def _lattice(i, j, k, seed):
    """Hash of a lattice point to [0, 1)."""
    h = np.uint32(i) * np.uint32(0x8DA6B343) ^ np.uint32(j) * np.uint32(0xD8163841)
    h = h ^ np.uint32(k) * np.uint32(0xCB1AB31F) ^ np.uint32(seed) * np.uint32(0x9E3779B1)
    h = np.uint32(h ^ (h >> np.uint32(15))) * np.uint32(0x2C1B3C6D)
    h = np.uint32(h ^ (h >> np.uint32(12))) * np.uint32(0x297A2D39)
    h = np.uint32(h ^ (h >> np.uint32(15)))
    return h / 4294967296.0


@numba.njit(cache=True)
def value_noise(points, octaves, seed):
    """Fractal value noise, smooth trilinear, each octave twice the frequency and half the amplitude.

    Args:
        points: (point, 3) float64; lattice spacing of the first octave is 1.
        octaves: number of octaves, >= 1.
        seed: non-negative integer below 2^31.

    Returns:
        (point,) float64 in [0, 1].
    """
    out = np.zeros(points.shape[0])
    for n in range(points.shape[0]):
        amplitude, frequency, total = 1.0, 1.0, 0.0
        for octave in range(octaves):
            x, y, z = points[n, 0] * frequency, points[n, 1] * frequency, points[n, 2] * frequency
            i, j, k = math.floor(x), math.floor(y), math.floor(z)
            fx, fy, fz = x - i, y - j, z - k
            fx, fy, fz = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy), fz * fz * (3 - 2 * fz)
            value = 0.0
            for corner in range(8):
                di, dj, dk = corner & 1, (corner >> 1) & 1, (corner >> 2) & 1
                weight = (fx if di else 1 - fx) * (fy if dj else 1 - fy) * (fz if dk else 1 - fz)
                value += weight * _lattice(int(i) + di, int(j) + dj, int(k) + dk, seed + octave)
            out[n] += amplitude * value
            total += amplitude
            amplitude *= 0.5
            frequency *= 2.0
        out[n] /= total
    return out
