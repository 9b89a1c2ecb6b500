"""At most four joints a vertex: what files and engines carry (glTF 2.0, section 3.7.3.3)."""

import numpy as np
from jaxtyping import Float, Int

MAX_INFLUENCES = 4

_LEAST = 2.0**-16
"""Weights below are dropped: less than a file with 16-bit weights could hold."""


def strongest_influences(
    weights: Float[np.ndarray, "vert bone"], joints: Int[np.ndarray, " bone"]
) -> tuple[Int[np.ndarray, "vert 4"], Float[np.ndarray, "vert 4"]]:
    """The four largest weights of each vertex, made to sum to 1 again.

    Args:
        weights: non-negative, rows summing to 1.
        joints: the joint of each bone.

    Returns:
        Joints, strongest first, and their weights; a place whose weight is 0 names joint 0.
    """
    order = np.argsort(-weights, axis=1, kind="stable")[:, :MAX_INFLUENCES]
    kept = np.take_along_axis(weights, order, axis=1)
    kept = np.where(kept < _LEAST, 0.0, kept)
    return np.where(kept > 0.0, joints[order], 0), kept / kept.sum(axis=1, keepdims=True)
