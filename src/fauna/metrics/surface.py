"""Distances between surfaces and volumes of surfaces that need not be watertight."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from fauna.kernels.closest_point import build_tree, distances_to_surface, morton_codes
from fauna.kernels.winding import crossings_along_z

F_THRESHOLD = 0.05
"""Distance within which a point counts for the F-score, diagonals of the truth's bounding box."""
VOXELS = 64
"""Voxels along the longest side of the common bounding box."""


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh.

    Attributes:
        verts: positions.
        faces: counter-clockwise seen from outside.
    """

    verts: Float[np.ndarray, "vert 3"]
    faces: Int[np.ndarray, "face 3"]

    @property
    def corners(self) -> Float[np.ndarray, "face 3 3"]:
        """Positions of each triangle's corners."""
        return np.ascontiguousarray(self.verts[self.faces], dtype=np.float64)


def face_areas(mesh: Mesh) -> Float[np.ndarray, " face"]:
    """Area of each triangle."""
    a, b, c = np.moveaxis(mesh.corners, 1, 0)
    x, y, z = np.cross(b - a, c - a).T
    return 0.5 * np.sqrt(x * x + y * y + z * z)


def centroid(mesh: Mesh) -> Float[np.ndarray, "3"]:
    """Centroid of the surface by area; of the vertices if all triangles are degenerate."""
    areas = face_areas(mesh)
    total = areas.sum()
    return (areas[:, None] * mesh.corners.mean(axis=1)).sum(axis=0) / total if total > 0 else mesh.verts.mean(axis=0)


def surface_points(mesh: Mesh, *, count: int, rng: np.random.Generator) -> Float[np.ndarray, "point 3"]:
    """Points uniform by area: one in each of ``count`` equal strata of the accumulated area.

    Args:
        mesh: with a positive area.
        count: number of points.
        rng: consumed.
    """
    totals = np.cumsum(face_areas(mesh))
    at = (np.arange(count) + rng.random(count)) / count * totals[-1]
    face = np.minimum(np.searchsorted(totals, at, side="right"), len(totals) - 1)
    u, v = np.sqrt(rng.random(count)), rng.random(count)
    shares = np.stack([1 - u, u * (1 - v), u * v], axis=1)
    return (mesh.corners[face] * shares[..., None]).sum(axis=1)


def distances(points: Float[np.ndarray, "point 3"], mesh: Mesh) -> Float[np.ndarray, " point"]:
    """Exact distance from each point to the nearest point of a surface."""
    corners = mesh.corners
    order = np.argsort(morton_codes(corners), kind="stable")
    tree = build_tree(corners, order)
    return distances_to_surface(np.ascontiguousarray(points, np.float64), corners, order, *tree)


def chamfer_and_f_score(
    predicted: Mesh, true: Mesh, *, threshold: float, count: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Symmetric Chamfer distance and F-score between points of each surface and the other surface itself.

    Args:
        predicted: aligned.
        true: in the same frame.
        threshold: distance within which a point counts as found.
        count: points drawn on each surface.
        rng: consumed.

    Returns:
        Mean of the two mean distances; harmonic mean of precision and recall in [0, 1].
    """
    forth = distances(surface_points(predicted, count=count, rng=rng), true)
    back = distances(surface_points(true, count=count, rng=rng), predicted)
    precision, recall = float((forth <= threshold).mean()), float((back <= threshold).mean())
    f_score = 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0
    return 0.5 * float(forth.mean() + back.mean()), f_score


def volume_iou(predicted: Mesh, true: Mesh) -> float:
    """IoU of the solids on a common grid of cubes, 64 along the longest side of the common bounding box; 1 where both are empty."""
    points = np.concatenate([predicted.corners.reshape(-1, 3), true.corners.reshape(-1, 3)])
    low, high = points.min(axis=0), points.max(axis=0)
    size = float((high - low).max()) / VOXELS
    if size <= 0:
        return 1.0
    shape = tuple(int(n) for n in np.ceil((high - low) / size - 1e-9).astype(np.int64).clip(1))
    first, second = (voxels(mesh, low, size, shape) for mesh in (predicted, true))
    union = int((first | second).sum())
    return float((first & second).sum() / union) if union else 1.0


def voxels(mesh: Mesh, low: Float[np.ndarray, "3"], size: float, shape: tuple[int, ...]) -> Bool[np.ndarray, "x y z"]:
    """Which cell centres lie inside. Robust to holes, to shells that overlap and to shells inside each other.

    From each centre six rays leave along the axes; a ray votes for inside if it crosses the surface outwards more often than
    inwards. More than half of the votes decide. The mean of the six signed counts is a coarse estimate of the generalised winding
    number (Jacobson et al., 2013): on closed shells all six agree, a hole misleads only the rays that pass through it.
    """
    votes = np.zeros(shape, np.int8)
    corners = mesh.corners
    for axis in range(3):
        order = [(axis + 1) % 3, (axis + 2) % 3, axis]  # a cyclic permutation keeps the orientation
        found = crossings_along_z(
            np.ascontiguousarray(corners[..., order]), low[order], size, tuple(shape[i] for i in order)
        )
        entered = np.cumsum(found, axis=2, dtype=np.int32)
        below, above = entered[..., :-1], entered[..., :-1] - entered[..., -1:]
        votes += ((below > 0).astype(np.int8) + (above > 0)).transpose(np.argsort(order))
    return votes > 3
