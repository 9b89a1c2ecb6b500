"""How a predicted surface is laid over the true one before they are compared: ``camera`` or ``similarity``."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from fauna.data.truth import Truth3D
from fauna.evaluation.prediction import Prediction
from fauna.metrics.camera import crop_camera
from fauna.metrics.surface import Mesh, centroid

ICP_STEPS = 20
ICP_POINTS = 500


@dataclass(frozen=True)
class Aligned:
    """Both surfaces in the crop camera's frame of the truth, in its units.

    Attributes:
        predicted: after alignment.
        true: the truth.
        size: diagonal of the truth's bounding box in its own frame; distances are reported as shares of it.
        vertical: unit vector, the animal's vertical axis.
    """

    predicted: Mesh
    true: Mesh
    size: float
    vertical: Float[np.ndarray, "3"]


def align_camera(prediction: Prediction, truth: Truth3D) -> Aligned:
    """Scale and depth only, no rotation and no sideways shift, in closed form.

    A camera cannot tell a small near animal from a large far one. The prediction is therefore moved to the depth of the true surface
    (centroids by area) and scaled so that it covers the share of the crop that the model gave it: the scale follows from depths and
    focal lengths and is not fitted. Any error that can be seen in the image, of size or of place, remains an error.
    """
    crop_from_world, focal = crop_camera(prediction.camera_from_world, prediction.clip_from_world)
    true_from_world, true_focal = crop_camera(truth.camera_from_world, truth.clip_from_world)
    predicted = Mesh(_move(crop_from_world, prediction.verts), prediction.faces)
    true = Mesh(_move(true_from_world, truth.verts), truth.faces)
    depth, true_depth = centroid(predicted)[2], centroid(true)[2]
    scale = (focal / depth) / (true_focal / true_depth)
    verts = predicted.verts * scale
    verts[:, 2] += true_depth - scale * depth
    size = float(np.linalg.norm(np.ptp(truth.verts, axis=0)))
    return Aligned(Mesh(verts, predicted.faces), true, size, true_from_world[:3, 1])


def align_similarity(aligned: Aligned, predicted_points: np.ndarray, true_points: np.ndarray) -> Aligned:
    """Rotation, translation and one scale that bring the surfaces together: iterated closest points in both directions.

    Starts from the camera alignment and from it turned by 180 degrees about the animal's vertical axis; the better end counts.

    Args:
        aligned: by :func:`align_camera`.
        predicted_points: (point, 3) points of the predicted surface.
        true_points: (point, 3) points of the true surface.
    """
    half_turn = 2.0 * np.outer(aligned.vertical, aligned.vertical) - np.eye(3)
    best, best_error = None, np.inf
    for rotation in (np.eye(3), half_turn):
        start = (predicted_points - predicted_points.mean(axis=0)) @ rotation.T + true_points.mean(axis=0)
        moved, error = iterate_closest_points(start, true_points)
        if error < best_error:
            best, best_error = moved, error
    assert best is not None
    scale, rotation, shift = procrustes(predicted_points, best)
    verts = scale * aligned.predicted.verts @ rotation.T + shift
    return Aligned(Mesh(verts, aligned.predicted.faces), aligned.true, aligned.size, aligned.vertical)


def iterate_closest_points(
    points: Float[np.ndarray, "point 3"], goal: Float[np.ndarray, "goal 3"]
) -> tuple[Float[np.ndarray, "point 3"], float]:
    """Points moved onto a goal by a fixed number of similarity fits, and the remaining mean squared distance.

    Correspondences go both ways, so that a small goal cannot be matched by shrinking to a point of it.
    """
    tree = KDTree(goal)
    start = points
    for _ in range(ICP_STEPS):
        forth = tree.query(points)[1]
        back = KDTree(points).query(goal)[1]
        scale, rotation, shift = procrustes(np.concatenate([start, start[back]]), np.concatenate([goal[forth], goal]))
        points = scale * start @ rotation.T + shift
    forth, back = tree.query(points)[0], KDTree(points).query(goal)[0]
    return points, float((forth**2).mean() + (back**2).mean())


def procrustes(
    points: Float[np.ndarray, "point 3"], goal: Float[np.ndarray, "point 3"]
) -> tuple[float, Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Scale, rotation (no reflection) and shift with least squared |scale rotation p + shift - goal| (Umeyama, 1991)."""
    mean, goal_mean = points.mean(axis=0), goal.mean(axis=0)
    centred, goal_centred = points - mean, goal - goal_mean
    left, values, right = np.linalg.svd(goal_centred.T @ centred)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = (left * signs) @ right
    spread = (centred**2).sum()
    scale = float((values * signs).sum() / spread) if spread > 0 else 1.0
    return scale, rotation, goal_mean - scale * rotation @ mean


def pa_mpjpe(predicted: Float[np.ndarray, "key 3"], true: Float[np.ndarray, "key 3"]) -> float:
    """Mean distance of keypoints after Procrustes alignment with scale, in the unit of ``true``; at least 3 keypoints."""
    scale, rotation, shift = procrustes(predicted, true)
    return float(np.linalg.norm(scale * predicted @ rotation.T + shift - true, axis=1).mean())


def _move(target_from_source: Float[np.ndarray, "4 4"], points: Float[np.ndarray, "point 3"]) -> np.ndarray:
    return points.astype(np.float64) @ target_from_source[:3, :3].T + target_from_source[:3, 3]
