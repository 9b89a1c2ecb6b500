"""From a ``.glb`` file to a model: nodes, skins, meshes and clips joined into plain arrays."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fauna.models3d.clips import Channel, Clip, Locals, world_from_node
from fauna.models3d.glb import Glb, accessor, read_glb
from fauna.models3d.materials import read_materials
from fauna.models3d.model import Model

TRIANGLES = 4
INTERPOLATIONS = ("STEP", "LINEAR", "CUBICSPLINE")
PATHS = {"translation": 3, "rotation": 4, "scale": 3}


@dataclass(frozen=True)
class _Part:
    """A primitive: its arrays, with weights over the slots of its mesh's node only."""

    verts: np.ndarray
    weights: np.ndarray
    uv: np.ndarray
    colours: np.ndarray
    faces: np.ndarray
    material: int


def load_model(path: Path) -> Model:
    """Read a model.

    Raises:
        FaunaError: for a file that is broken, has no skin or no triangles.
    """
    glb = read_glb(path)
    nodes = [glb.entry("nodes", index) for index in range(len(glb.document.get("nodes", [])))]
    if not glb.document.get("skins"):
        raise glb.error("a skin (a rigged model)", "none")
    try:
        return _assemble(glb, nodes)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise glb.error("sound glTF 2.0", f"a broken entry ({type(error).__name__}: {error})") from error


def _assemble(glb: Glb, nodes: list[dict[str, Any]]) -> Model:
    parents = np.full(len(nodes), -1)
    for index, node in enumerate(nodes):
        parents[node.get("children", [])] = index
    slot_nodes: list[int] = []
    inverse_bind: list[np.ndarray] = []
    skinned: list[tuple[int, list[int], np.ndarray]] = []
    parts: list[tuple[int, _Part]] = []
    for index, node in enumerate(nodes):
        if "mesh" not in node:
            continue
        first = len(slot_nodes)
        joints, matrices = _skin(glb, node.get("skin"), index)
        if "skin" in node:
            skinned.append((index, joints, matrices))
        slot_nodes += joints
        inverse_bind += list(matrices)
        primitives = glb.entry("meshes", node["mesh"])["primitives"]
        parts += [(first, _part(glb, each, len(joints))) for each in primitives if each.get("mode", 4) == TRIANGLES]
    if not parts:
        raise glb.error("a mesh of triangles", "none")
    sizes = [len(part.verts) for _, part in parts]
    offsets = np.cumsum([0, *sizes[:-1]])
    rest = _rest(glb, nodes)
    weights = np.zeros((sum(sizes), len(slot_nodes)))
    for offset, (first, part) in zip(offsets, parts, strict=True):
        weights[offset : offset + len(part.verts), first : first + part.weights.shape[1]] = part.weights
    return Model(
        name=glb.path.stem,
        node_names=tuple(str(node.get("name", f"node{index}")) for index, node in enumerate(nodes)),
        parents=parents,
        rest=rest,
        bind_world=_bind_world(world_from_node(rest, parents), parents, skinned),
        clips={clip.name: clip for clip in _clips(glb, len(nodes))},
        slot_nodes=np.array(slot_nodes),
        inverse_bind=np.stack(inverse_bind),
        verts=np.concatenate([part.verts for _, part in parts]),
        weights=weights,
        uv=np.concatenate([part.uv for _, part in parts]),
        colours=np.concatenate([part.colours for _, part in parts]),
        faces=np.concatenate([part.faces + offset for offset, (_, part) in zip(offsets, parts, strict=True)]),
        face_materials=np.concatenate([np.full(len(part.faces), part.material) for _, part in parts]),
        materials=read_materials(glb),
    )


def _skin(glb: Glb, skin: int | None, node: int) -> tuple[list[int], np.ndarray]:
    """Joints and inverse bind matrices of a mesh's node; without a skin the node itself."""
    if skin is None:
        return [node], np.eye(4)[None]
    entry = glb.entry("skins", skin)
    joints = [int(joint) for joint in entry["joints"]]
    for joint in joints:
        glb.entry("nodes", joint)
    if "inverseBindMatrices" not in entry:
        return joints, np.repeat(np.eye(4)[None], len(joints), 0)
    matrices = accessor(glb, entry["inverseBindMatrices"]).astype(float)
    if matrices.shape[1:] != (4, 4) or len(matrices) < len(joints):
        raise glb.error(f"{len(joints)} inverse bind matrices in skins[{skin}]", f"shape {matrices.shape}")
    return joints, matrices[: len(joints)]


def _bind_world(
    rest_world: np.ndarray, parents: np.ndarray, skinned: list[tuple[int, list[int], np.ndarray]]
) -> np.ndarray:
    """The pose in which a skinned mesh stands as its own node places it, in the size it has at rest."""
    world, known = rest_world.copy(), np.zeros(len(parents), bool)
    for node, joints, inverse_bind in skinned:
        bound = rest_world[node] @ np.linalg.inv(inverse_bind)
        size = np.linalg.det(rest_world[joints][:, :3, :3]) / np.linalg.det(bound[:, :3, :3])
        world[joints] = np.diag([*(np.median(np.cbrt(size)),) * 3, 1.0]) @ bound
        known[joints] = True
    for node in np.flatnonzero(~known).tolist():
        joint = _ancestor(node, parents, known)
        if joint >= 0:  # it follows that joint
            world[node] = world[joint] @ np.linalg.inv(rest_world[joint]) @ rest_world[node]
    return world


def _ancestor(node: int, parents: np.ndarray, among: np.ndarray) -> int:
    """Nearest ancestor that is marked, -1 for none."""
    while node >= 0 and not among[node]:
        node = int(parents[node])
    return node


def _part(glb: Glb, primitive: dict[str, Any], slots: int) -> _Part:
    attributes = primitive["attributes"]
    verts = accessor(glb, attributes["POSITION"]).astype(float)
    count = len(verts)
    flat = accessor(glb, primitive["indices"]) if "indices" in primitive else np.arange(count)
    if len(flat) % 3 or flat.max() >= count:
        raise glb.error(f"triangles of {count} vertices", f"{len(flat)} indices up to {flat.max()}")
    return _Part(
        verts=verts,
        weights=_weights(glb, attributes, count, slots),
        uv=_attribute(glb, attributes, "TEXCOORD_0", np.zeros((count, 2))),
        colours=_attribute(glb, attributes, "COLOR_0", np.ones((count, 3)))[:, :3],
        faces=flat.astype(np.int64).reshape(-1, 3),
        material=int(primitive.get("material", -1)),
    )


def _attribute(glb: Glb, attributes: dict[str, int], name: str, default: np.ndarray) -> np.ndarray:
    if name not in attributes:
        return default
    values = accessor(glb, attributes[name]).astype(float)
    if len(values) != len(default):
        raise glb.error(f"{len(default)} values of {name}", str(len(values)))
    return values


def _weights(glb: Glb, attributes: dict[str, int], count: int, slots: int) -> np.ndarray:
    """Dense skinning weights; every set JOINTS_n, WEIGHTS_n counts."""
    dense = np.zeros((count, slots))
    sets = [name[7:] for name in sorted(attributes) if name.startswith("JOINTS_")]
    if slots == 1 and not sets:
        return np.ones((count, 1))
    for each in sets:
        joints = _attribute(glb, attributes, f"JOINTS_{each}", np.zeros((count, 4))).astype(np.int64)
        shares = _attribute(glb, attributes, f"WEIGHTS_{each}", np.zeros((count, 4)))
        if joints.max() >= slots:
            raise glb.error(f"joints below {slots}", str(joints.max()))
        for column in range(joints.shape[1]):
            np.add.at(dense, (np.arange(count), joints[:, column]), shares[:, column])
    total = dense.sum(1, keepdims=True)
    if (total <= 0).any():
        raise glb.error("skinning weights at every vertex", f"{int((total <= 0).sum())} vertices without")
    return dense / total


def _rest(glb: Glb, nodes: list[dict[str, Any]]) -> Locals:
    local = Locals(np.zeros((len(nodes), 3)), np.tile([0.0, 0.0, 0.0, 1.0], (len(nodes), 1)), np.ones((len(nodes), 3)))
    for index, node in enumerate(nodes):
        if "matrix" in node:
            matrix = np.array(node["matrix"], float).reshape(4, 4).T
            scale = np.linalg.norm(matrix[:3, :3], axis=0) * [1, 1, np.sign(np.linalg.det(matrix[:3, :3]))]
            local.translation[index], local.scale[index] = matrix[:3, 3], scale
            local.rotation[index] = Rotation.from_matrix(matrix[:3, :3] / scale).as_quat()
        local.translation[index] = node.get("translation", local.translation[index])
        local.rotation[index] = node.get("rotation", local.rotation[index])
        local.scale[index] = node.get("scale", local.scale[index])
    if not all(np.isfinite(each).all() for each in (local.translation, local.rotation, local.scale)):
        raise glb.error("finite transforms of nodes", "others")
    return local


def _clips(glb: Glb, nodes: int) -> list[Clip]:
    clips = []
    for number, animation in enumerate(glb.document.get("animations", [])):
        channels = []
        for entry in animation["channels"]:
            target = entry["target"]
            if target.get("path") in PATHS and "node" in target:  # morph weights are passed over
                channels.append(_channel(glb, animation["samplers"][entry["sampler"]], target))
        if any(not 0 <= channel.node < nodes for channel in channels):
            raise glb.error(f"animated nodes below {nodes}", f"others in animations[{number}]")
        clips.append(Clip(str(animation.get("name", f"clip{number}")), tuple(channels)))
    return clips


def _channel(glb: Glb, sampler: dict[str, Any], target: dict[str, Any]) -> Channel:
    path, interpolation = target["path"], sampler.get("interpolation", "LINEAR")
    times = accessor(glb, sampler["input"]).astype(float)
    values = accessor(glb, sampler["output"]).astype(float)
    parts = 3 if interpolation == "CUBICSPLINE" else 1
    if interpolation not in INTERPOLATIONS or values.shape != (len(times) * parts, PATHS[path]):
        raise glb.error(f"{len(times) * parts} keyframes of {path}", f"{interpolation} with shape {values.shape}")
    if not (np.diff(times) > 0).all():
        raise glb.error("keyframes in increasing order", f"others in a {path}")
    return Channel(target["node"], path, interpolation, times, values.reshape(len(times), parts, -1))
