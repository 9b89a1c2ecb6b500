"""Random animals for the export: bodies of ellipsoids, the project's own bones and skin, any pose."""

from dataclasses import dataclass

import numpy as np
import torch
import trimesh

from fauna.export import RiggedAnimal
from fauna.export.rig import RestAnimal, rig_animal
from fauna.geometry.rig import Rig
from fauna.geometry.skeleton import SkeletonOptions, rest_skeleton
from fauna.geometry.skinning import bone_transforms, skin, skinning_weights

OPTIONS = SkeletonOptions(
    body_height=0.5,
    centre_lift=0.5,
    foot_quantile=0.4,
    margin=0.2,
    foot_origin="median",
    symmetric_feet=True,
    attachment="z_nearest",
)
RIG = Rig(OPTIONS, skin_temperature=0.05, skin_distance="euclidean")


def body(generator: np.random.Generator, *, detail: int = 2) -> trimesh.Trimesh:
    """Trunk, neck, head and four legs of random proportions, facing +z; closed, in several pieces."""
    length, leg, width = generator.uniform((1.0, 0.6, 0.35), (1.6, 1.5, 0.7))
    neck = generator.uniform(0.2, 0.9)
    parts = [
        ((0.0, 0.2, 0.0), (width, 0.5, length)),
        ((0.0, 0.5 + neck / 2, length), (0.2, 0.2 + neck / 2, 0.3)),
        ((0.0, 0.5 + neck, length + 0.4), (0.22, 0.2, 0.45)),
    ]
    for x in (-0.6, 0.6):
        for z in (-0.75, 0.7):
            parts.append(((x * width, -leg / 2, z * length), (0.13, leg / 2 + 0.2, 0.16)))
    pieces = []
    for centre, radii in parts:
        sphere = trimesh.creation.icosphere(subdivisions=detail)
        pieces.append(trimesh.Trimesh(sphere.vertices * radii + centre, sphere.faces, process=False))
    return trimesh.util.concatenate(pieces)


def rest_animal(seed: int, *, bend: float = 0.5, attached: bool = True, detail: int = 2) -> RestAnimal:
    """A random body in a random pose of angles up to ``bend`` radians, posed with all weights."""
    generator = np.random.default_rng(seed)
    mesh = body(generator, detail=detail)
    verts = torch.from_numpy(np.asarray(mesh.vertices, np.float64))
    skeleton = rest_skeleton(verts[None], options=OPTIONS, legs_attached=attached)
    angles = torch.from_numpy(generator.uniform(-bend, bend, (20, 3)))
    weights = skinning_weights(verts[None], skeleton, temperature=RIG.skin_temperature, distance=RIG.skin_distance)
    posed = skin(verts[None], weights, bone_transforms(skeleton, angles[None]))[0]
    return RestAnimal(verts, torch.from_numpy(np.asarray(mesh.faces, np.int64)), skeleton, angles, posed)


def animal(seed: int, *, name: str = "animal", back_height: float = 1.0, **more) -> RiggedAnimal:
    return rig_animal(RIG, rest_animal(seed, **more), name=name, back_height=back_height)


@dataclass(frozen=True, eq=False)
class Atlas:
    """Every face in a triangle of its own."""

    vertex: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    image: np.ndarray


def atlas(faces: np.ndarray, seed: int, size: int = 64) -> Atlas:
    generator = np.random.default_rng(seed)
    corners = 3 * len(faces)
    return Atlas(
        vertex=faces.reshape(-1),
        faces=np.arange(corners).reshape(-1, 3),
        uv=generator.random((corners, 2)),
        image=generator.integers(0, 256, (size, size, 3), dtype=np.uint8),
    )
