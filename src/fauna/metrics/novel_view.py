"""Silhouettes from views that the model has not seen."""

import numpy as np
import torch
from jaxtyping import Bool, Float

from fauna.metrics.alignment import Aligned
from fauna.metrics.surface import Mesh
from fauna.renderer.numba_backend import NumbaRenderer

VIEWS = 8
SIZE = 128
"""Pixels per axis of a view."""


def view_rotations(vertical: Float[np.ndarray, "3"]) -> Float[np.ndarray, "view 3 3"]:
    """Turns about an axis by 22.5, 67.5, ... 337.5 degrees: all around the animal, none of them the photo's own view."""
    angles = 2 * np.pi * (np.arange(VIEWS) + 0.5) / VIEWS
    x, y, z = vertical
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.stack([np.eye(3) + np.sin(a) * cross + (1 - np.cos(a)) * cross @ cross for a in angles])


def outlines(
    mesh: Mesh, centre: Float[np.ndarray, "3"], radius: float, rotations: Float[np.ndarray, "view 3 3"]
) -> Bool[np.ndarray, "view size size"]:
    """Parallel projections along -z of the turned mesh, a ball about ``centre`` filling the pictures."""
    turned = np.einsum("vij,nj->vni", rotations, (mesh.verts - centre) / (1.02 * radius), optimize=False)
    clip = np.concatenate([turned * [1.0, -1.0, -1.0], np.ones((*turned.shape[:2], 1))], axis=2)
    faces = torch.from_numpy(mesh.faces.astype(np.int64))
    seen = NumbaRenderer().rasterize(torch.from_numpy(clip), faces, SIZE, SIZE).covered
    return seen.numpy()


def novel_view_iou(aligned: Aligned) -> float:
    """Mean IoU of the silhouettes of prediction and truth from eight views around the truth's vertical axis.

    Args:
        aligned: in the camera frame; the views keep the photo's elevation.
    """
    low, high = aligned.true.verts.min(axis=0), aligned.true.verts.max(axis=0)
    centre = 0.5 * (low + high)
    meshes = (aligned.predicted, aligned.true)
    radius = max(float(np.linalg.norm(mesh.verts - centre, axis=1).max()) for mesh in meshes)
    first, second = (outlines(mesh, centre, radius, view_rotations(aligned.vertical)) for mesh in meshes)
    union = (first | second).sum(axis=(1, 2))
    both = (first & second).sum(axis=(1, 2))
    return float(np.where(union > 0, both / np.maximum(union, 1), 1.0).mean())
