"""Animation clips: keyframes and their interpolation (glTF 2.0, section 3.11 and appendix C)."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from fauna.errors import FaunaError

Path = Literal["translation", "rotation", "scale"]
Interpolation = Literal["STEP", "LINEAR", "CUBICSPLINE"]


@dataclass(frozen=True)
class Locals:
    """Transform of every node relative to its parent.

    Attributes:
        translation: file units.
        rotation: unit quaternions x y z w.
        scale: factors along the node's axes.
    """

    translation: Float[np.ndarray, "node 3"]
    rotation: Float[np.ndarray, "node 4"]
    scale: Float[np.ndarray, "node 3"]

    def copy(self) -> "Locals":
        """The same in arrays of its own."""
        return Locals(self.translation.copy(), self.rotation.copy(), self.scale.copy())


@dataclass(frozen=True)
class Channel:
    """Keyframes of one property of one node.

    Attributes:
        node: index.
        path: the property.
        interpolation: between keyframes.
        times: increasing, seconds.
        values: by keyframe; for ``CUBICSPLINE`` the middle axis holds in-tangent, value, out-tangent, else it has length 1.
    """

    node: int
    path: Path
    interpolation: Interpolation
    times: Float[np.ndarray, " key"]
    values: Float[np.ndarray, "key part width"]

    def at(self, time: float) -> Float[np.ndarray, " width"]:
        """Value at a time; clamped to the first and last keyframe."""
        times, values = self.times, self.values
        middle = values.shape[1] // 2
        right = int(np.searchsorted(times, time, side="right"))
        if right == 0 or right == len(times) or self.interpolation == "STEP":
            return _unit(values[max(right - 1, 0), middle], self.path)
        step = times[right] - times[right - 1]
        t = (time - times[right - 1]) / step
        before, after = values[right - 1], values[right]
        if self.interpolation == "CUBICSPLINE":
            spline = (
                (2 * t**3 - 3 * t**2 + 1) * before[1]
                + step * (t**3 - 2 * t**2 + t) * before[2]
                + (3 * t**2 - 2 * t**3) * after[1]
                + step * (t**3 - t**2) * after[0]
            )
            return _unit(spline, self.path)
        if self.path == "rotation":
            return slerp(before[0], after[0], t)
        return (1 - t) * before[0] + t * after[0]


@dataclass(frozen=True)
class Clip:
    """A named animation.

    Attributes:
        name: as in the file.
        channels: its keyframes.
    """

    name: str
    channels: tuple[Channel, ...]

    @property
    def duration(self) -> float:
        """Time of the last keyframe, seconds."""
        return max((float(channel.times[-1]) for channel in self.channels), default=0.0)

    def at(self, rest: Locals, time: float) -> Locals:
        """Local transforms at a time; what no channel moves stays at rest.

        Args:
            rest: transforms without animation.
            time: seconds.
        """
        posed = rest.copy()
        for channel in self.channels:
            getattr(posed, channel.path)[channel.node] = channel.at(time)
        return posed


def slerp(first: Float[np.ndarray, "4"], second: Float[np.ndarray, "4"], t: float) -> Float[np.ndarray, "4"]:
    """Shortest arc between two unit quaternions."""
    cosine = float(first @ second)
    if cosine < 0:
        second, cosine = -second, -cosine
    angle = np.arccos(min(cosine, 1.0))
    if angle < 1e-4:
        return _unit((1 - t) * first + t * second, "rotation")
    return _unit((np.sin((1 - t) * angle) * first + np.sin(t * angle) * second) / np.sin(angle), "rotation")


def _unit(value: np.ndarray, path: Path) -> np.ndarray:
    return value / max(float(np.linalg.norm(value)), 1e-12) if path == "rotation" else value


def matrices(local: Locals) -> Float[np.ndarray, "node 4 4"]:
    """Translation times rotation times scale of every node."""
    x, y, z, w = local.rotation.T
    rotation = np.stack(
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
         2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
         2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], -1,
    ).reshape(-1, 3, 3)  # fmt: skip
    out = np.zeros((len(rotation), 4, 4))
    out[:, :3, :3] = rotation * local.scale[:, None, :]
    out[:, :3, 3] = local.translation
    out[:, 3, 3] = 1.0
    return out


def world_from_node(local: Locals, parents: Int[np.ndarray, " node"]) -> Float[np.ndarray, "node 4 4"]:
    """Chain local transforms from the roots.

    Args:
        local: of every node.
        parents: index of the parent, -1 at a root, in any order.

    Raises:
        FaunaError: when the parents form a ring.
    """
    world = matrices(local)
    done = np.asarray(parents) < 0
    waiting = list(np.flatnonzero(~done))
    while waiting:
        ready = [node for node in waiting if done[parents[node]]]
        if not ready:
            raise FaunaError("a model expects nodes that form trees, got a ring of parents; export it again")
        for node in ready:
            world[node] = world[parents[node]] @ world[node]
        done[ready] = True
        waiting = [node for node in waiting if not done[node]]
    return world


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
