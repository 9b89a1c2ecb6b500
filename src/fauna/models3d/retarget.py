"""Clips of one animal for another with joints of the same names."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from fauna.models3d.clips import Channel, Clip, Locals


@dataclass(frozen=True)
class Skeleton:
    """What a clip needs to know of the nodes it moves, in the pose their skin was bound in.

    Attributes:
        names: by node.
        bound: local transforms.
        height: a length that tells how large the animal is, file units.
    """

    names: tuple[str, ...]
    bound: Locals
    height: float


def borrow(clip: Clip, donor: Skeleton, taker: Skeleton) -> Clip:
    """A clip for another animal with joints of the same names and axes.

    What the clip does to the donor relative to its bound pose it does to the taker: rotations are repeated, translations
    scaled with the height, scales multiplied. Joints the taker lacks are passed over.
    """
    size = taker.height / donor.height
    channels = []
    for channel in clip.channels:
        name = donor.names[channel.node]
        if name not in taker.names:
            continue
        node = taker.names.index(name)
        ours, theirs = getattr(taker.bound, channel.path)[node], getattr(donor.bound, channel.path)[channel.node]
        if channel.path == "rotation":
            turn = quaternion_product(ours, theirs * [-1, -1, -1, 1])
            values = quaternion_product(turn, channel.values)
        elif channel.path == "translation":
            value = 1 if channel.interpolation != "CUBICSPLINE" else np.array([0.0, 1.0, 0.0])[:, None]
            values = channel.values * size + (ours - theirs * size) * value
        else:
            values = channel.values * (ours / theirs)
        channels.append(Channel(node, channel.path, channel.interpolation, channel.times, values))
    return Clip(clip.name, tuple(channels))


def quaternion_product(
    first: Float[np.ndarray, "*a 4"], second: Float[np.ndarray, "*b 4"]
) -> Float[np.ndarray, "*c 4"]:
    """Rotation by ``second``, then by ``first``; x y z w."""
    v, w = first[..., :3], first[..., 3:]
    u, s = second[..., :3], second[..., 3:]
    vector = w * u + s * v + np.cross(v, u)
    return np.concatenate([vector, w * s - (v * u).sum(-1, keepdims=True)], -1)


def local_from_world(world: Float[np.ndarray, "node 4 4"], parents: Int[np.ndarray, " node"]) -> Locals:
    """Undo :func:`world_from_node`, for transforms without shear."""
    above = np.where((np.asarray(parents) < 0)[:, None, None], np.eye(4), world[parents])
    local = np.linalg.inv(above) @ world
    scale = np.linalg.norm(local[:, :3, :3], axis=1)
    scale[:, 2] *= np.sign(np.linalg.det(local[:, :3, :3]))
    rotation = Rotation.from_matrix(local[:, :3, :3] / scale[:, None]).as_quat()
    return Locals(local[:, :3, 3], rotation, scale)
