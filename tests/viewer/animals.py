"""A small rigged animal, made by hand."""

from dataclasses import dataclass, replace

import numpy as np
import trimesh

from fauna.export.animal import Clip, RiggedAnimal

JOINTS = 21


@dataclass(frozen=True)
class Picture:
    """A texture over all faces: the left half of the picture red, the right half blue."""

    vertex: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    image: np.ndarray


def box_animal() -> RiggedAnimal:
    """A long box with its lower half on one joint, which the clip ``walk`` swings; nothing else moves."""
    mesh = trimesh.creation.box((0.6, 1.0, 2.0)).subdivide().subdivide()
    vertices = np.asarray(mesh.vertices) + [0.0, 0.5, 0.0]
    starts, ends = np.zeros((JOINTS, 3)), np.zeros((JOINTS, 3))
    starts[:, 1], ends[:, 2] = 0.5, 0.1
    influences, weights = np.zeros((len(vertices), 4), int), np.zeros((len(vertices), 4))
    influences[vertices[:, 1] < 0.5, 0] = 9
    weights[:, 0] = 1.0
    still = np.tile([0.0, 0.0, 0.0, 1.0], (JOINTS, 1))
    return RiggedAnimal(
        name="box", vertices=vertices, faces=np.asarray(mesh.faces, dtype=np.int64), parents=np.array([-1] + [0] * (JOINTS - 1)),
        starts=starts, ends=ends, frames=np.tile(np.eye(3), (JOINTS, 1, 1)), influences=influences, weights=weights, photo=still,
        metres_per_unit=1.0, origin=np.zeros(3), body_length=2.0, skin_error_max=0.0, skin_error_mean=0.0, clips=(swing(),),
    )  # fmt: skip


def swing() -> Clip:
    """Joint 9 swings about x by 0.6 radians to both sides, once a second."""
    times = np.linspace(0.0, 1.0, 9)
    angle = 0.6 * np.sin(2 * np.pi * times)
    rotations = np.tile([0.0, 0.0, 0.0, 1.0], (9, JOINTS, 1))
    rotations[:, 9, 0], rotations[:, 9, 3] = np.sin(angle / 2), np.cos(angle / 2)
    return Clip("walk", times, rotations, np.zeros((9, 3)), loop=True, speed=1.0, extras={})


def textured(animal: RiggedAnimal) -> RiggedAnimal:
    """The animal, its left side (x > 0) red and its right side blue by a picture."""
    corners = animal.vertices[animal.faces].reshape(-1, 3)
    uv = np.stack([np.where(corners[:, 0] > 0, 0.25, 0.75), np.full(len(corners), 0.5)], axis=1)
    side = np.repeat(animal.vertices[animal.faces].mean(axis=1)[:, 0], 3)
    uv[:, 0] = np.where(side > 0, 0.25, 0.75)
    image = np.zeros((8, 8, 3), np.uint8)
    image[:, :4, 0], image[:, 4:, 2] = 255, 255
    picture = Picture(animal.faces.ravel(), np.arange(len(corners)).reshape(-1, 3), uv.astype(np.float32), image)
    return replace(animal, texture=picture)
