"""What of a predicted mesh is seen in its photo."""

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from fauna.evaluation.prediction import Prediction
from fauna.renderer.numba_backend import NumbaRenderer

SIZE = 256
"""Pixels per axis of the picture that decides visibility."""


def project(
    clip_from_world: Float[np.ndarray, "4 4"], points: Float[np.ndarray, "*lead 3"]
) -> Float[np.ndarray, "*lead 4"]:
    """Homogeneous clip positions, float64, each point summed in the same order whatever their number."""
    matrix = clip_from_world.astype(np.float64)
    x, y, z = np.moveaxis(points.astype(np.float64), -1, 0)
    return np.stack([x * row[0] + y * row[1] + z * row[2] + row[3] for row in matrix], axis=-1)


def to_ndc(
    clip_from_world: Float[np.ndarray, "4 4"], points: Float[np.ndarray, "*lead 3"]
) -> Float[np.ndarray, "*lead 2"]:
    """NDC x, y (y down); NaN for points that are not in front of the camera."""
    clip = project(clip_from_world, points)
    w = np.where(clip[..., 3:] > 1e-6, clip[..., 3:], np.nan)
    return clip[..., :2] / w


def visible_vertices(prediction: Prediction) -> Bool[np.ndarray, " vert"]:
    """True where a vertex belongs to a face that owns at least one of 256 x 256 pixels (as in the published evaluation)."""
    clip = torch.from_numpy(project(prediction.clip_from_world, prediction.verts))[None]
    faces = torch.from_numpy(prediction.faces.astype(np.int64))
    seen = NumbaRenderer().rasterize(clip, faces, SIZE, SIZE).face_index
    flags = np.zeros(len(prediction.verts), bool)
    flags[prediction.faces[np.unique(seen[seen >= 0].numpy())]] = True
    return flags


def keypoint_vertices(prediction: Prediction, keypoints: Float[np.ndarray, "key 3"]) -> Int[np.ndarray, " key"]:
    """Nearest visible vertex to each annotated keypoint in the image; -1 where none is annotated or nothing is visible.

    Args:
        prediction: of the photo.
        keypoints: NDC x, y and 1 where annotated.
    """
    candidates = np.flatnonzero(visible_vertices(prediction))
    found = np.full(len(keypoints), -1, np.int64)
    if not len(candidates):
        return found
    ndc = to_ndc(prediction.clip_from_world, prediction.verts[candidates])
    wanted = np.flatnonzero(keypoints[:, 2] > 0)
    x, y = (keypoints[wanted, None, axis] - ndc[:, axis] for axis in (0, 1))
    away = x * x + y * y
    found[wanted] = candidates[away.argmin(axis=1)] if len(wanted) else -1
    return found
