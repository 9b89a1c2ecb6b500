"""A rigged model as plain arrays, and its skinning."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fauna.models3d.clips import Clip, Locals, world_from_node
from fauna.models3d.materials import Material
from fauna.zoo.products import dot


@dataclass(frozen=True)
class Model:
    """One rigged model, in the units and the frame of its file (y up, the head meant to be at +z).

    A *slot* is a joint of a skin together with its inverse bind matrix; a mesh without skin hangs on a slot of its own node.

    Attributes:
        name: stem of the file.
        node_names: by node.
        parents: of each node, -1 at a root.
        rest: local transforms without animation.
        bind_world: world from node in the pose the skin was made in, which is the symmetric one.
        clips: animations by name.
        slot_nodes: node of each slot.
        inverse_bind: slot from mesh.
        verts: mesh positions, as stored.
        weights: rows sum to 1.
        uv: texture coordinates, 0 where there are none.
        colours: linear vertex colours, 1 where there are none.
        faces: counter-clockwise seen from outside.
        face_materials: index into ``materials``.
        materials: colours and pictures.
    """

    name: str
    node_names: tuple[str, ...]
    parents: Int[np.ndarray, " node"]
    rest: Locals
    bind_world: Float[np.ndarray, "node 4 4"]
    clips: dict[str, Clip]
    slot_nodes: Int[np.ndarray, " slot"]
    inverse_bind: Float[np.ndarray, "slot 4 4"]
    verts: Float[np.ndarray, "vert 3"]
    weights: Float[np.ndarray, "vert slot"]
    uv: Float[np.ndarray, "vert 2"]
    colours: Float[np.ndarray, "vert 3"]
    faces: Int[np.ndarray, "face 3"]
    face_materials: Int[np.ndarray, " face"]
    materials: tuple[Material, ...]

    def node(self, name: str) -> int:
        """Index of a node; raises KeyError when there is none."""
        try:
            return self.node_names.index(name)
        except ValueError as error:
            raise KeyError(name) from error


def skin(model: Model, world: Float[np.ndarray, "node 4 4"]) -> Float[np.ndarray, "vert 3"]:
    """Linear-blend skinning (glTF 2.0, section 3.7.3.3).

    Args:
        model: the model.
        world: world from node.

    Returns:
        Posed vertices.
    """
    slots = np.einsum("sij,sjk->sik", world[model.slot_nodes], model.inverse_bind, optimize=False)[:, :3]
    blended = dot(model.weights, slots.reshape(-1, 12)).reshape(-1, 3, 4)
    return np.einsum("vij,vj->vi", blended[:, :, :3], model.verts, optimize=False) + blended[:, :, 3]


def pose(model: Model, local: Locals) -> tuple[Float[np.ndarray, "vert 3"], Float[np.ndarray, "node 4 4"]]:
    """Posed vertices, and world from node."""
    world = world_from_node(local, model.parents)
    return skin(model, world), world
