"""Individuals and their poses: what clip, what moment, what proportions."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fauna.models3d.animal import TAILBASE, WITHERS, Animal, apply
from fauna.models3d.clips import Locals, world_from_node
from fauna.models3d.model import skin
from fauna.models3d.retarget import local_from_world
from fauna.zoo.products import dot
from fauna.zoo.surface import vertex_normals


@dataclass(frozen=True)
class Build:
    """How an individual differs from its model.

    Attributes:
        stretch: factors along x, y, z.
        head: size of the head.
        neck: length of the neck.
        tail: size of the tail.
        girth: thickness added to the trunk and to the legs, withers heights.
    """

    stretch: Float[np.ndarray, "3"]
    head: float
    neck: float
    tail: float
    girth: Float[np.ndarray, "2"]


def sample_build(rng: np.random.Generator) -> Build:
    """Fat and thin, long and short individuals, about five per cent apart."""
    stretch = np.exp(rng.normal(0, 1, 3) * [0.05, 0.04, 0.05])
    head, neck, tail = np.exp(rng.normal(0, 1, 3) * [0.06, 0.06, 0.1])
    return Build(stretch, float(head), float(neck), float(tail), rng.normal(0, 1, 2) * [0.016, 0.004])


def sample_moment(animal: Animal, rng: np.random.Generator) -> tuple[str | None, float]:
    """A clip, each as likely, and a time within it; ``(None, 0)``, the bound pose, for a model without clips."""
    names, choice, share = list(animal.clips), rng.random(), rng.random()
    if not names:
        return None, 0.0
    name = names[int(choice * len(names))]
    return name, share * animal.clips[name].duration


def pose_animal(
    animal: Animal, build: Build, clip: str | None, time: float
) -> tuple[Float[np.ndarray, "vert 3"], Float[np.ndarray, "20 3"]]:
    """Fine vertices and keypoints of an individual in a pose, in the animal's frame.

    The trunk is turned about the vertical to look where it does in the bound pose, along +z, so that azimuths mean the same in a clip that turns on the spot.

    Args:
        animal: the model.
        build: the individual.
        clip: name of a clip, ``None`` for the bound pose.
        time: seconds.
    """
    model = animal.model
    if clip is None:
        local = local_from_world(model.bind_world, model.parents)
    else:
        local = animal.clips[clip].at(model.rest, time)
    world = world_from_node(_reproportioned(animal, build, local), model.parents)
    to_animal = np.diag([*build.stretch, 1.0]) @ animal.animal_from_file
    verts = apply(to_animal, animal.refinement.fine_from_coarse @ skin(model, world))
    verts = verts + dot(animal.girth, build.girth)[:, None] * vertex_normals(verts, animal.refinement.faces)
    points = animal.binding.at(verts, to_animal @ world)
    bound = (animal.keypoints[WITHERS] - animal.keypoints[TAILBASE]) * build.stretch
    turn = _turned_back(bound, points[WITHERS] - points[TAILBASE])
    return dot(verts, turn.T), dot(points, turn.T)


def _reproportioned(animal: Animal, build: Build, local: Locals) -> Locals:
    """Head and tail grow about their first joints; the joints of the neck move apart."""
    rig, model, changed = animal.entry.rig, animal.model, local.copy()
    changed.scale[model.node(rig.head)] *= build.head
    for name in rig.neck:
        changed.translation[model.node(name)] *= build.neck
    if rig.tail in model.node_names:
        changed.scale[model.node(rig.tail)] *= build.tail
    return changed


def _turned_back(bound: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """Rotation about y that takes the posed direction of the trunk to the bound one; none for a trunk that stands upright."""
    if np.hypot(ahead[0], ahead[2]) < 0.3 * np.linalg.norm(ahead):
        return np.eye(3)
    angle = np.arctan2(bound[0], bound[2]) - np.arctan2(ahead[0], ahead[2])
    sine, cosine = np.sin(angle), np.cos(angle)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
