"""A rigged animal in memory, in the frame of the files: y up, facing +z, metres, the ground at y = 0."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation


@runtime_checkable
class UvTexture(Protocol):
    """What a texture has to have; :class:`fauna.texture.Texture` does.

    Attributes:
        vertex: (uv_vert,) index of the mesh's vertex.
        faces: (face, 3) into the uv vertices, in the order of the mesh's faces.
        uv: (uv_vert, 2) in [0, 1], origin at the picture's TOP left as in glTF.
        image: (height, width, 3) 8-bit sRGB.
    """

    @property
    def vertex(self) -> Any: ...  # noqa: D102
    @property
    def faces(self) -> Any: ...  # noqa: D102
    @property
    def uv(self) -> Any: ...  # noqa: D102
    @property
    def image(self) -> Any: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class Clip:
    """An animation, linear between its frames.

    Attributes:
        name: unique in an animal.
        times: (frame,) seconds, rising from 0.
        rotations: (frame, joint, 4) unit quaternions xyzw, relative to rest, in the joint's own axes.
        translation: (frame, 3) of the root relative to rest, metres.
        loop: last frame equals the first.
        speed: metres per second over the ground along +z that an in-place clip was made for.
        extras: further facts for the file.
    """

    name: str
    times: Float[np.ndarray, " frame"]
    rotations: Float[np.ndarray, "frame 21 4"]
    translation: Float[np.ndarray, "frame 3"]
    loop: bool
    speed: float
    extras: dict[str, Any]


@dataclass(frozen=True, eq=False)
class RiggedAnimal:
    """Mesh, skeleton, skin and clips of one animal; arrays are float64 and in the order of ``JOINT_NAMES``.

    Attributes:
        name: for the file.
        vertices: (vert, 3) at rest, which is the bind pose.
        faces: (face, 3) counter-clockwise seen from outside.
        parents: (joint,) index of the parent, -1 for the root; smaller than the joint's own index.
        starts: (joint, 3) rest positions of the joints.
        ends: (joint, 3) where each bone ends.
        frames: (joint, 3, 3) rest axes as columns, see ``docs/skeleton.md``.
        influences: (vert, 4) joints that carry a vertex, strongest first; 0 where the weight is 0.
        weights: (vert, 4) non-negative, summing to 1.
        photo: (joint, 4) the photo's pose: unit quaternions xyzw, relative to rest, in the joint's own axes.
        metres_per_unit: metres of the file per world unit of the model.
        origin: (3,) the file's origin in the model's canonical frame, world units.
        body_length: extent of the mesh at rest along z, metres.
        skin_error_max: farthest that four weights move a vertex of the photo's pose from where all move it, share of
            ``body_length``.
        skin_error_mean: the same on average over the vertices.
        texture: picture and atlas, or ``None``.
        colours: (vert, 3) sRGB in [0, 1], shown when there is no texture, or ``None``.
        clips: animations other than the photo's pose.
        notes: what is doubtful about the rig, one sentence each.
    """

    name: str
    vertices: Float[np.ndarray, "vert 3"]
    faces: Int[np.ndarray, "face 3"]
    parents: Int[np.ndarray, " joint"]
    starts: Float[np.ndarray, "21 3"]
    ends: Float[np.ndarray, "21 3"]
    frames: Float[np.ndarray, "21 3 3"]
    influences: Int[np.ndarray, "vert 4"]
    weights: Float[np.ndarray, "vert 4"]
    photo: Float[np.ndarray, "21 4"]
    metres_per_unit: float
    origin: Float[np.ndarray, " 3"]
    body_length: float
    skin_error_max: float
    skin_error_mean: float
    texture: UvTexture | None = None
    colours: Float[np.ndarray, "vert 3"] | None = None
    clips: tuple[Clip, ...] = ()
    notes: tuple[str, ...] = ()

    def joint_transforms(
        self,
        rotations: Float[np.ndarray, "*batch 21 4"],
        translation: Float[np.ndarray, "*batch 3"] | None = None,
    ) -> Float[np.ndarray, "*batch 21 4 4"]:
        """Place of every joint in a pose.

        Args:
            rotations: relative to rest, as in :class:`Clip`.
            translation: of the root relative to rest, metres.
        """
        turns = Rotation.from_quat(rotations.reshape(-1, 4)).as_matrix().reshape(*rotations.shape[:-1], 3, 3)
        world = np.zeros((*rotations.shape[:-1], 4, 4))
        world[..., 3, 3] = 1.0
        for joint, parent in enumerate(self.parents):
            world[..., joint, :3, :3] = self.frames[joint] @ turns[..., joint, :, :]
            world[..., joint, :3, 3] = self.starts[joint]
            if parent >= 0:
                rest = rigid(self.frames[parent], self.starts[parent])
                world[..., joint, :, :] = world[..., parent, :, :] @ np.linalg.inv(rest) @ world[..., joint, :, :]
            elif translation is not None:
                world[..., joint, :3, 3] += translation
        return world

    def pose(
        self, rotations: Float[np.ndarray, "21 4"], translation: Float[np.ndarray, " 3"] | None = None
    ) -> Float[np.ndarray, "vert 3"]:
        """Vertices in a pose: linear blend skinning with the four weights."""
        moved = self.joint_transforms(rotations, translation) @ np.linalg.inv(rigid(self.frames, self.starts))
        blended = np.einsum("vi,vijk->vjk", self.weights, moved[self.influences, :3])
        return np.einsum("vjk,vk->vj", blended[..., :3], self.vertices) + blended[..., 3]

    def to_world(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Points of the file in the model's canonical frame, where the photo's camera is given."""
        return points / self.metres_per_unit + self.origin


def rigid(
    rotation: Float[np.ndarray, "*batch 3 3"], translation: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch 4 4"]:
    """Homogeneous matrices."""
    matrix = np.zeros((*rotation.shape[:-2], 4, 4))
    matrix[..., :3, :3], matrix[..., :3, 3], matrix[..., 3, 3] = rotation, translation, 1.0
    return matrix
