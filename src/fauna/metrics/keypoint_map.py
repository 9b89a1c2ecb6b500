"""Keypoints as fixed mixtures of surface points, fitted per species (CMR's linear map; Sec. 5.3, PCK).

CMR learns K x V weights whose rows are a softmax, by gradient descent. Here each row is the solution of a convex problem with the same
constraints: non-negative least squares with weights that sum to one. There is no learning rate, no stopping and no seed.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import nnls

from fauna.evaluation.prediction import Prediction
from fauna.metrics.lookup import Places, SurfaceIndex, vertex_places
from fauna.metrics.visibility import project
from fauna.random import derive_seed

REFERENCE_POINTS = 400
"""Points of the reference surface that keypoints are mixed from."""


def in_fit_half(names: Sequence[str], *, seed: int) -> Bool[np.ndarray, " image"]:
    """True for the half of the photos that the map is fitted on (the larger half of an odd number): a pure function of seed and names."""
    order = sorted(range(len(names)), key=lambda i: (derive_seed(seed, "keypoint map", names[i]), names[i]))
    half = np.zeros(len(names), bool)
    half[order[: (len(names) + 1) // 2]] = True
    return half


def reference_places(prediction: Prediction, *, count: int) -> Places:
    """Well spread vertices of one surface: each next one is the farthest from those chosen, in the base shape."""
    places = vertex_places(prediction)
    points = places.general
    chosen = [int(np.linalg.norm(points, axis=1).argmax())]
    away = np.full(len(points), np.inf)
    for _ in range(min(count, len(points)) - 1):
        x, y, z = (points - points[chosen[-1]]).T
        away = np.minimum(away, x * x + y * y + z * z)
        chosen.append(int(away.argmax()))
    return places.rows(np.array(chosen))


def resample(predictions: Sequence[Prediction], places: Places) -> Float[np.ndarray, "image point 3"]:
    """Posed positions of the places on each surface, world units, by the canonical lookup."""
    rows = []
    for prediction in predictions:
        corners, weights = SurfaceIndex.of(prediction).find(places)
        rows.append((prediction.verts[corners] * weights[..., None]).sum(axis=1).astype(np.float64))
    return np.stack(rows) if rows else np.zeros((0, len(places.bone), 3))


def fit_map(
    clip: Float[np.ndarray, "image point 4"], keypoints: Float[np.ndarray, "image key 3"]
) -> Float[np.ndarray, "key point"]:
    """Weights of each keypoint, non-negative with sum 1; a row of NaN for a keypoint that no photo shows.

    With the homogeneous image a_v p_v of the mixture, the residual (sum_v a_v (p_v - y w_v)) / mean w vanishes exactly when the 3D
    mixture projects to the annotation y, and it is linear in the weights: perspective needs no approximation.

    Args:
        clip: homogeneous clip positions of the reference points in each photo.
        keypoints: NDC x, y and 1 where annotated.
    """
    images, points, _ = clip.shape
    depth = clip[..., 3].mean(axis=1)[:, None, None]
    place, w = clip[..., :2] / depth, clip[..., 3:] / depth
    rows = np.full((keypoints.shape[1], points), np.nan)
    for key in range(keypoints.shape[1]):
        seen = keypoints[:, key, 2] > 0
        if not seen.any():
            continue
        residual = place[seen] - keypoints[seen, None, key, :2] * w[seen]  # (image, point, 2)
        matrix = residual.transpose(0, 2, 1).reshape(-1, points) / np.sqrt(seen.sum())
        rows[key] = _mixture(matrix)
    return rows


def apply_map(
    weights: Float[np.ndarray, "key point"], positions: Float[np.ndarray, "image point 3"]
) -> Float[np.ndarray, "image key 3"]:
    """3D keypoints: the mixtures of the posed reference points."""
    return np.einsum("kp,ipc->ikc", weights, positions, optimize=False)


def clip_positions(
    predictions: Sequence[Prediction], positions: Float[np.ndarray, "image point 3"]
) -> Float[np.ndarray, "image point 4"]:
    """Homogeneous clip positions of points of each photo."""
    rows = [project(p.clip_from_world, points) for p, points in zip(predictions, positions, strict=True)]
    return np.stack(rows) if rows else np.zeros((0, positions.shape[1], 4))


def map_keypoints(
    predictions: Sequence[Prediction],
    keypoints: Float[np.ndarray, "image key 3"],
    fit: Bool[np.ndarray, " image"],
    positions: Float[np.ndarray, "image point 3"],
) -> Float[np.ndarray, "image key 3"]:
    """3D keypoints of every photo by the map fitted on the photos marked in ``fit``; world units, NaN for unfitted keypoints."""
    chosen: Int[np.ndarray, " fit"] = np.flatnonzero(fit)
    clip = clip_positions([predictions[i] for i in chosen], positions[chosen])
    return apply_map(fit_map(clip, keypoints[chosen]), positions)


def _mixture(matrix: Float[np.ndarray, "row point"]) -> Float[np.ndarray, " point"]:
    """Minimise |matrix a| over non-negative a with sum 1.

    Solved as min |matrix a|^2 + (sum a - 1)^2 over non-negative a, then normalised. That is the same: for a = s b with sum b = 1 the best
    s leaves |matrix b|^2 / (1 + |matrix b|^2), which grows with |matrix b|.
    """
    rows, points = matrix.shape
    if rows > points:
        matrix = np.asarray(np.linalg.qr(matrix, mode="r"))
    system = np.concatenate([matrix, np.ones((1, points))])
    goal = np.zeros(len(system))
    goal[-1] = 1.0
    weights, _ = nnls(system, goal, maxiter=30 * points)
    return weights / weights.sum()
