"""Rigged animals as binary glTF 2.0: one skinned mesh, its skeleton and its clips, nothing else."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

import fauna
from fauna.export.animal import Clip, RiggedAnimal, rigid
from fauna.export.container import Container
from fauna.export.joints import BONE_OF_JOINT, JOINT_NAMES, NUM_JOINTS, ROOT, SKELETON_VERSION
from fauna.export.surface import is_closed, linear_from_srgb, normals, png, split_at_seams

PHOTO = "photo"
"""Name of the clip that holds the photo's pose."""

_STILL = 1e-7
"""Curves that change less are written as two keys."""

_ROUGHNESS = 0.9
_MESH_NODE, _RIG_NODE, _FIRST_JOINT = 0, 1, 2


def write_glb(animal: RiggedAnimal, path: Path) -> None:
    """Write a ``.glb`` file; it appears complete or not at all.

    Raises:
        OSError: when the file cannot be written.
    """
    partial = path.with_name(path.name + ".part")
    partial.write_bytes(glb_bytes(animal))
    partial.replace(path)


def glb_bytes(animal: RiggedAnimal) -> bytes:
    """The content of a ``.glb`` file; the same animal gives the same bytes.

    Rest is the bind pose. Clips come in the order ``photo`` (two equal frames), then those of the animal.
    """
    container = Container({"asset": _asset(animal), "scene": 0})
    container.document |= {
        "scenes": [{"name": animal.name, "nodes": [_MESH_NODE, _RIG_NODE]}],
        "nodes": _nodes(animal),
        "meshes": [{"name": animal.name, "primitives": [_primitive(container, animal)]}],
        "materials": [_material(container, animal)],
        "skins": [_skin(container, animal)],
        "animations": [_animation(container, animal, clip) for clip in (photo_clip(animal), *animal.clips)],
    }
    return container.to_bytes()


def photo_clip(animal: RiggedAnimal) -> Clip:
    """The photo's pose as a clip of a second in which nothing moves."""
    still = np.repeat(animal.photo[None], 2, axis=0)
    return Clip(PHOTO, np.array([0.0, 1.0]), still, np.zeros((2, 3)), loop=False, speed=0.0, extras={})


def _asset(animal: RiggedAnimal) -> dict[str, Any]:
    facts = {
        "skeleton": SKELETON_VERSION,
        "unit": "metre",
        "scale": "assumed: a photograph has none",
        "metres_per_unit": animal.metres_per_unit,
        "origin": animal.origin.tolist(),
        "back_height": float(animal.starts[ROOT, 1]),
        "body_length": animal.body_length,
        "skin_error_max": animal.skin_error_max,
        "skin_error_mean": animal.skin_error_mean,
        "notes": list(animal.notes),
    }
    return {"version": "2.0", "generator": f"fauna {fauna.__version__}", "extras": facts}


def _nodes(animal: RiggedAnimal) -> list[dict[str, Any]]:
    """The mesh, which is a root of the scene, the rig's place on the ground, and the joints."""
    nodes: list[dict[str, Any]] = [
        {"name": animal.name, "mesh": 0, "skin": 0},
        {"name": "armature", "children": [_FIRST_JOINT + ROOT]},
    ]
    turns, places = _rest_locals(animal)
    for joint, name in enumerate(JOINT_NAMES):
        node = {"name": name, "rotation": turns[joint].tolist(), "translation": places[joint].tolist()}
        children = [_FIRST_JOINT + child for child in range(NUM_JOINTS) if animal.parents[child] == joint]
        if children:
            node["children"] = children
        if BONE_OF_JOINT[joint] is not None:
            length = float(np.linalg.norm(animal.ends[joint] - animal.starts[joint]))
            node["extras"] = {"bone": BONE_OF_JOINT[joint], "length": length}
        nodes.append(node)
    return nodes


def _rest_locals(animal: RiggedAnimal) -> tuple[Float[np.ndarray, "joint 4"], Float[np.ndarray, "joint 3"]]:
    """Rotation (xyzw) and translation of every joint at rest in its parent's axes, single precision."""
    above = animal.parents.clip(min=0)
    has = (animal.parents >= 0)[:, None]
    axes = np.where(has[..., None], animal.frames[above], np.eye(3)).swapaxes(1, 2)
    places = animal.starts - np.where(has, animal.starts[above], 0.0)
    turns = Rotation.from_matrix(axes @ animal.frames).as_quat(canonical=True)
    return turns.astype(np.float32), np.einsum("jab,jb->ja", axes, places).astype(np.float32)


def _primitive(container: Container, animal: RiggedAnimal) -> dict[str, Any]:
    split = split_at_seams(animal)
    at = split.vertex
    vertex_data = {
        "POSITION": animal.vertices[at].astype(np.float32),
        "NORMAL": normals(animal.vertices, animal.faces)[at].astype(np.float32),
        "JOINTS_0": animal.influences[at].astype(np.uint8),
        "WEIGHTS_0": animal.weights[at].astype(np.float32),
    }
    if split.uv is not None:
        vertex_data["TEXCOORD_0"] = split.uv.astype(np.float32)
    elif animal.colours is not None:
        vertex_data["COLOR_0"] = linear_from_srgb(animal.colours)[at].astype(np.float32)
    attributes = {name: container.add(values, usage="vertices") for name, values in vertex_data.items()}
    index_type = np.uint16 if len(at) < 2**16 - 1 else np.uint32  # the largest index means "start again"
    indices = container.add(split.faces.reshape(-1).astype(index_type), usage="faces")
    return {"attributes": attributes, "indices": indices, "material": 0}


def _material(container: Container, animal: RiggedAnimal) -> dict[str, Any]:
    """Dull, of the texture's colour; both sides show where the surface has holes."""
    look: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": _ROUGHNESS}
    if animal.texture is not None:
        view = container.view(png(animal.texture), usage="data")
        container.document["images"] = [{"name": "coat", "bufferView": view, "mimeType": "image/png"}]
        container.document["samplers"] = [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}]
        container.document["textures"] = [{"source": 0, "sampler": 0}]
        look["baseColorTexture"] = {"index": 0}
    material: dict[str, Any] = {"name": "coat", "pbrMetallicRoughness": look}
    return material if is_closed(animal.faces) else material | {"doubleSided": True}


def _skin(container: Container, animal: RiggedAnimal) -> dict[str, Any]:
    axes = animal.frames.swapaxes(1, 2)
    inverse = rigid(axes, -np.einsum("jab,jb->ja", axes, animal.starts)).astype(np.float32)
    matrices = container.add(inverse, usage="data")
    joints = list(range(_FIRST_JOINT, _FIRST_JOINT + NUM_JOINTS))
    return {"name": "skeleton", "joints": joints, "skeleton": _RIG_NODE, "inverseBindMatrices": matrices}


def _animation(container: Container, animal: RiggedAnimal, clip: Clip) -> dict[str, Any]:
    """Every joint's rotation and the root's place, moving or not: Blender keeps what a clip leaves out."""
    rest, places = _rest_locals(animal)
    curves = [("rotation", joint, _absolute(rest[joint], clip.rotations[:, joint])) for joint in range(NUM_JOINTS)]
    curves.append(("translation", ROOT, places[ROOT] + clip.translation))
    samplers, channels, inputs = [], [], {}
    for path, joint, values in curves:
        still = bool(np.abs(values - values[0]).max() < _STILL)
        keys = [0, -1] if still else slice(None)
        if still not in inputs:
            inputs[still] = container.add(clip.times[keys].astype(np.float32), usage="data")
        output = container.add(values[keys].astype(np.float32), usage="data")
        channels.append({"sampler": len(samplers), "target": {"node": _FIRST_JOINT + joint, "path": path}})
        samplers.append({"input": inputs[still], "output": output, "interpolation": "LINEAR"})
    facts = {"loop": clip.loop, "ground_speed": clip.speed, "root_motion": [0.0, 0.0, clip.speed]} | clip.extras
    return {"name": clip.name, "samplers": samplers, "channels": channels, "extras": facts}


def _absolute(rest: Float[np.ndarray, " 4"], turns: Float[np.ndarray, "frame 4"]) -> Float[np.ndarray, "frame 4"]:
    """Rotations in the parent's axes; neighbouring quaternions on the same side, so that mixing them is short."""
    quaternions = (Rotation.from_quat(rest) * Rotation.from_quat(turns)).as_quat()
    flips = np.sign(np.einsum("fk,fk->f", quaternions[1:], quaternions[:-1]))
    flips = np.where(flips < 0, -1.0, 1.0)
    quaternions[1:] *= np.cumprod(flips)[:, None]
    return quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
