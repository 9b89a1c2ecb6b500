"""Forward kinematics of the zoo's anatomical skeletons and dual-quaternion skinning (Kavan et al., 2007)."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from fauna.zoo.products import dot


def bone_transforms(
    joints: Mapping[str, np.ndarray],
    parents: Mapping[str, str | None],
    angles: Mapping[str, tuple[float, float, float]],
) -> dict[str, np.ndarray]:
    """Posed-from-rest transform of every bone.

    Args:
        joints: rest position of each bone's joint, parents before children.
        parents: parent of each bone, ``None`` at the root.
        angles: rotations about x, y, z of the rest frame (extrinsic, radians), applied in the parent's posed frame; missing is 0.
            A positive x angle moves what points forward downwards and what hangs down backwards.

    Returns:
        (4, 4) rigid matrices by bone.
    """
    transforms: dict[str, np.ndarray] = {}
    for name, joint in joints.items():
        local = np.eye(4)
        local[:3, :3] = Rotation.from_euler("zyx", angles.get(name, (0.0, 0.0, 0.0))[::-1]).as_matrix()
        local[:3, 3] = joint - local[:3, :3] @ joint
        parent = parents[name]
        transforms[name] = local if parent is None else transforms[parent] @ local
    return transforms


def skin(
    verts: Float[np.ndarray, "vert 3"],
    weights: Float[np.ndarray, "vert bone"],
    transforms: Float[np.ndarray, "bone 4 4"],
) -> Float[np.ndarray, "vert 3"]:
    """Blend rigid motions as dual quaternions, which keeps the volume of bent limbs.

    Args:
        verts: rest positions.
        weights: rows sum to 1.
        transforms: posed-from-rest per bone.
    """
    real = Rotation.from_matrix(transforms[:, :3, :3]).as_quat()  # (bone, 4) x y z w
    moved = transforms[:, :3, 3]
    vector, scalar = real[:, :3], real[:, 3:]
    dual = 0.5 * np.concatenate([scalar * moved + np.cross(moved, vector), -(moved * vector).sum(1, keepdims=True)], 1)
    pivot = real[weights.argmax(1)]
    signed = weights * np.where(dot(pivot, real.T) < 0, -1.0, 1.0)
    real, dual = dot(signed, real), dot(signed, dual)
    size = np.linalg.norm(real, axis=1, keepdims=True)
    real, dual = real / size, dual / size
    vector, scalar = real[:, :3], real[:, 3:]
    turned = verts + 2 * np.cross(vector, np.cross(vector, verts) + scalar * verts)
    shift = 2 * (scalar * dual[:, :3] - dual[:, 3:] * vector + np.cross(vector, dual[:, :3]))
    return turned + shift
