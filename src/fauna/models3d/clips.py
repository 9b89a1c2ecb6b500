"""Animation clips: keyframes and their interpolation (glTF 2.0, section 3.11 and appendix C)."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

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
