"""Writes small ``.glb`` files for the tests, accessor by accessor."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from fauna.zoo.species import HORSE

COMPONENT = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
KIND = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}


class Writer:
    """Collects accessors and writes the file."""

    def __init__(self) -> None:
        self.binary = b""
        self.document: dict[str, Any] = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
            "accessors": [], "bufferViews": [], "buffers": [{}],
        }  # fmt: skip

    def view(self, data: bytes, **more: int) -> int:
        """A buffer view of its own."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        self.document["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **more}
        )
        self.binary += data
        return len(self.document["bufferViews"]) - 1

    def add(self, values: np.ndarray, dtype: str, **more: Any) -> int:
        """An accessor in a view of its own; matrices are given rows first."""
        stored = np.asarray(values).astype("<" + dtype)
        shape = stored.shape[1:]
        data = (stored.swapaxes(1, 2) if shape == (4, 4) else stored).tobytes()
        entry = {
            "bufferView": self.view(data), "componentType": COMPONENT[dtype], "count": len(stored), "type": KIND[shape], **more,
        }  # fmt: skip
        self.document["accessors"].append(entry)
        return len(self.document["accessors"]) - 1

    def bytes(self) -> bytes:
        """The container."""
        self.document["buffers"][0] = {"byteLength": len(self.binary)}
        text = json.dumps(self.document).encode()
        text += b" " * (-len(text) % 4)
        binary = self.binary + b"\0" * (-len(self.binary) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
        return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks

    def write(self, path: Path) -> Path:
        """Write the file."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(self.bytes())
        return path


JOINTS = {
    "Back": "pelvis", "Shoulders": "chest", "Neck": "neck1", "Head": "head",
    **{
        f"{end}{part}.{letter}": f"{side}_{end.lower()}_{joint}"
        for side, letter in (("left", "L"), ("right", "R"))
        for end, joints in (("Front", ("elbow", "knee", "foot")), ("Back", ("stifle", "hock", "foot")))
        for part, joint in zip(("UpLeg", "LowLeg", "Foot"), joints, strict=True)
    },
}  # fmt: skip
"""Joints of the farm rig, and the zoo's joints in their places."""


def write_quadruped(path: Path, *, clips: bool = True, squeeze: float = 1.0) -> Path:
    """A coarse horse of the zoo on the joints of the farm rig, with a walk and a death; file units are centimetres.

    Args:
        path: where to.
        clips: whether it has any.
        squeeze: factor on its width, to make another animal.
    """
    from fauna.zoo.build import build_body
    from fauna.zoo.surface import build_surface

    body = build_body(HORSE)
    surface = build_surface(body, cells=26, fleece=0.0)
    names, zoo = ["root", *JOINTS], list(body.joints)
    parents = {name: "root" for name in JOINTS} | {"Neck": "Shoulders", "Head": "Neck"}
    for end in ("Front", "Back"):
        for letter in "LR":
            parents |= {f"{end}LowLeg.{letter}": f"{end}UpLeg.{letter}", f"{end}Foot.{letter}": f"{end}LowLeg.{letter}"}
    scale = np.array([squeeze, 1.0, 1.0]) * 100
    place = {"root": np.zeros(3), **{name: body.joints[each] * scale for name, each in JOINTS.items()}}
    owner = [_nearest_joint(each, body.parents, zoo) for each in zoo]
    weights = np.zeros((len(surface.verts), len(names)))
    for column, name in enumerate(owner):
        weights[:, names.index(name)] += surface.weights[:, column]
    best = np.argsort(-weights, axis=1)[:, :4]
    shares = np.take_along_axis(weights, best, 1)
    writer = Writer()
    nodes = [
        {"name": name, "translation": (place[name] - place.get(parents.get(name, ""), 0)).tolist()} for name in names
    ]
    for index, node in enumerate(nodes):
        children = [names.index(name) for name, parent in parents.items() if parent == names[index]]
        if children:
            node["children"] = children
    inverse = np.tile(np.eye(4), (len(names), 1, 1))
    inverse[:, :3, 3] = [-place[name] for name in names]
    places = (surface.verts * scale).astype(np.float32)
    bounds = {"min": places.min(axis=0).tolist(), "max": places.max(axis=0).tolist()}
    attributes = {
        "POSITION": writer.add(places, "f4", **bounds), "JOINTS_0": writer.add(best, "u1"),
        "WEIGHTS_0": writer.add(shares / shares.sum(1, keepdims=True), "f4"),
    }  # fmt: skip
    primitive = {"attributes": attributes, "indices": writer.add(surface.faces.ravel(), "u4"), "material": 0}
    writer.document |= {
        "nodes": [*nodes, {"name": "Mesh", "mesh": 0, "skin": 0}], "scenes": [{"nodes": [0, len(nodes)]}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [{"name": "Main", "pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.1, 0.05, 1]}}],
        "skins": [{"joints": list(range(len(names))), "inverseBindMatrices": writer.add(inverse, "f4")}],
        "animations": _clips(writer, names) if clips else [],
    }  # fmt: skip
    return writer.write(path)


def _nearest_joint(name: str, parents: dict[str, str | None], zoo: list[str]) -> str:
    """The farm rig's joint that carries the flesh of a zoo's joint."""
    taken = {each: joint for joint, each in JOINTS.items()}
    up: str | None = name
    while up is not None:
        if up in taken:
            return taken[up]
        up = parents[up]
    return "Back"


def _clips(writer: Writer, names: list[str]) -> list[dict[str, Any]]:
    times = writer.add(np.array([0.0, 0.5, 1.0]), "f4")
    found = []
    for clip, angle in (("Walk", 0.4), ("Death", 1.5), ("Spin", 0.0)):
        channels, samplers = [], []
        for name in names:
            if name.startswith(("FrontUpLeg", "BackUpLeg")) and clip != "Spin":
                sign = 1 if name.endswith("L") == name.startswith("Front") else -1
                turns = [
                    (np.sin(0.5 * a), 0.0, 0.0, np.cos(0.5 * a)) for a in (sign * angle, -sign * angle, sign * angle)
                ]
            elif name == "root" and clip == "Spin":
                turns = [(0.0, np.sin(0.5 * a), 0.0, np.cos(0.5 * a)) for a in (0.5, 1.0, 1.5)]
            else:
                continue
            channels.append({"sampler": len(samplers), "target": {"node": names.index(name), "path": "rotation"}})
            samplers.append({"input": times, "output": writer.add(np.array(turns), "f4")})
        found.append({"name": f"Armature|{clip}", "channels": channels, "samplers": samplers})
    return found
