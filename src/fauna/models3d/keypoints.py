"""The twenty keypoints and the leg labels of a rigged model, bound to its joints and its fine vertices once, at rest."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fauna.data.truth import LEGS
from fauna.models3d.model import Model, skin
from fauna.models3d.refine import Refinement
from fauna.models3d.rigs import Place, Rig
from fauna.zoo.body import KEYPOINTS
from fauna.zoo.products import dot

MIDLINE = 0.04
"""Half width of the strip about the mirror plane that counts as its line, share of the model's height."""


@dataclass(frozen=True)
class Binding:
    """Keypoints bound to a model.

    Attributes:
        nodes: node each keypoint rides on, -1 where it is a vertex.
        offsets: place in that node's frame.
        vertices: fine vertex, -1 where it rides on a node.
    """

    nodes: Int[np.ndarray, "20"]
    offsets: Float[np.ndarray, "20 3"]
    vertices: Int[np.ndarray, "20"]

    def at(self, verts: Float[np.ndarray, "vert 3"], world: Float[np.ndarray, "node 4 4"]) -> Float[np.ndarray, "20 3"]:
        """Keypoints of a pose.

        Args:
            verts: fine posed vertices.
            world: transforms of the nodes in the same frame.
        """
        carried = np.einsum("kij,kj->ki", world[self.nodes, :3, :3], self.offsets) + world[self.nodes, :3, 3]
        return np.where(self.vertices[:, None] >= 0, verts[self.vertices], carried)


def bind(
    model: Model,
    rig: Rig,
    refinement: Refinement,
    eye: tuple[float, float, float],
    ear: tuple[float, float, float],
) -> Binding:
    """Find the keypoints of a model in the pose it was bound in.

    Args:
        model: the model; left is +x, the head at +z.
        rig: its skeleton family.
        refinement: its fine mesh.
        eye: forward, up, sideways from the head's joint, in lengths from there to the nose (forward is that way).
        ear: likewise; the skin nearest to these places is taken on each side.
    """
    world = model.bind_world
    verts = refinement.fine_from_coarse @ skin(model, world)
    shares = refinement.fine_from_coarse @ model.weights
    nodes, offsets, vertices = np.full(20, -1), np.zeros((20, 3)), np.full(20, -1)
    head = _region(model, shares, (rig.head, *rig.snout)) > 0.5
    nose, frame = head_frame(model, rig, verts, head, world)
    for index, keypoint in enumerate(KEYPOINTS):
        side, _, part = keypoint.partition("_")
        if part in ("eye", "ear"):
            place = frame[:, 3] + dot(np.array(eye if part == "eye" else ear) * _mirror(side), frame[:, :3].T)
            near = np.linalg.norm(verts - place, axis=1) + np.where(verts[:, 0] * _mirror(side)[2] > 0, 0, np.inf)
            vertices[index] = int(near.argmin())
        elif keypoint == "nose":
            vertices[index] = nose
        else:
            name = part if side in ("left", "right") else keypoint
            node, place, toward = _place(model, world, rig.places[name], rig.sides[side == "right"])
            if toward is None:
                nodes[index] = node
                offsets[index] = (np.linalg.inv(world[node]) @ np.append(place, 1.0))[:3]
            else:
                vertices[index] = _seen(verts, place, toward)
    return Binding(nodes, offsets, vertices)


def head_frame(
    model: Model, rig: Rig, verts: np.ndarray, head: np.ndarray, world: np.ndarray
) -> tuple[int, Float[np.ndarray, "3 4"]]:
    """Vertex of the nose, and the columns forward, up, left and origin of the head, scaled by its length.

    The nose is the foremost vertex of the head near the mirror plane; horns and ears do not reach it.
    """
    line = head & (np.abs(verts[:, 0]) < MIDLINE * np.ptp(verts[:, 1]))
    nose = int(np.where(line, verts[:, 2] - np.abs(verts[:, 0]), -np.inf).argmax())
    origin = world[model.node(rig.head), :3, 3] * [0, 1, 1]
    forward = verts[nose] * [0, 1, 1] - origin
    up = np.array([0.0, forward[2], -forward[1]])
    return nose, np.stack([forward, up, np.array([np.linalg.norm(forward), 0.0, 0.0]), origin], 1)


def leg_shares(model: Model, rig: Rig, refinement: Refinement) -> Float[np.ndarray, "vert 4"]:
    """Weight that each fine vertex gives to the joints of each leg, in the order of :data:`fauna.data.truth.LEGS`."""
    shares = refinement.fine_from_coarse @ model.weights
    columns = []
    for leg in LEGS:
        side, _, end = leg.partition("_")
        joints = rig.front_leg if end == "front" else rig.back_leg
        names = tuple(name.replace("{S}", rig.sides[side == "right"]) for name in joints)
        columns.append(_region(model, shares, names))
    return np.stack(columns, 1)


def loose_share(model: Model, rig: Rig, refinement: Refinement) -> Float[np.ndarray, " vert"]:
    """Weight that each fine vertex gives to joints that never rest on the ground: neck, head, tail."""
    names = tuple(name for name in model.node_names if name.startswith(rig.loose))
    return _region(model, refinement.fine_from_coarse @ model.weights, names)


def _region(model: Model, shares: np.ndarray, joints: tuple[str, ...]) -> np.ndarray:
    """Weight that a vertex gives to the named joints together."""
    names = [model.node_names[node] for node in model.slot_nodes]
    return shares[:, [name in joints for name in names]].sum(1)


def _mirror(side: str) -> np.ndarray:
    return np.array([1.0, 1.0, 1.0 if side == "left" else -1.0])


def _place(model: Model, world: np.ndarray, place: Place, side: str) -> tuple[int, np.ndarray, np.ndarray | None]:
    """The joint a keypoint rides on, where it is, and the direction to its place on the skin."""
    start, end = (model.node(name.replace("{S}", side)) for name in (place.start, place.end))
    way = world[end, :3, 3] - world[start, :3, 3]
    point = world[start, :3, 3] + place.share * way + np.array([0.0, 0.0, place.forward * np.linalg.norm(way)])
    if place.toward is None:
        return start, point, None
    if place.toward == "under":
        return start, point, np.array([0.0, -way[2], way[1]]) - 0.5 * way
    return start, point, np.array(place.toward)


def _seen(verts: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> int:
    """Vertex nearest to the ray; of those about as near, the first one met."""
    direction = direction / np.linalg.norm(direction)
    away = verts - origin
    along = dot(away, direction)
    beside = np.linalg.norm(away - along[:, None] * direction, axis=1)
    return int(np.where(along > 0, beside + 0.15 * along, np.inf).argmin())
