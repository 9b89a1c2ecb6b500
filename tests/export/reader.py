"""A minimal glTF player, written for the tests alone: reads the container and poses the mesh as the standard says."""

import json
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@dataclass
class Player:
    """A file, and what a viewer would show of it."""

    document: dict[str, Any]
    binary: bytes

    @classmethod
    def of(cls, content: bytes) -> "Player":
        assert content[:4] == b"glTF"
        version, length = struct.unpack_from("<II", content, 4)
        assert (version, length) == (2, len(content))
        size, kind = struct.unpack_from("<I4s", content, 12)
        assert kind == b"JSON"
        binary_size, kind = struct.unpack_from("<I4s", content, 20 + size)
        assert kind == b"BIN\0"
        assert 28 + size + binary_size == length
        return cls(json.loads(content[20 : 20 + size]), content[28 + size :])

    def array(self, accessor: int) -> np.ndarray:
        entry = self.document["accessors"][accessor]
        view = self.document["bufferViews"][entry["bufferView"]]
        width, kind = WIDTHS[entry["type"]], TYPES[entry["componentType"]]
        values = np.frombuffer(self.binary, kind, entry["count"] * width, view["byteOffset"])
        return values.reshape(entry["count"], width)

    def attribute(self, name: str) -> np.ndarray | None:
        attributes = self.document["meshes"][0]["primitives"][0]["attributes"]
        return self.array(attributes[name]) if name in attributes else None

    def indices(self) -> np.ndarray:
        return self.array(self.document["meshes"][0]["primitives"][0]["indices"]).reshape(-1, 3)

    def clip(self, name: str) -> dict[str, Any]:
        (found,) = [clip for clip in self.document["animations"] if clip["name"] == name]
        return found

    def duration(self, name: str) -> float:
        return max(float(self.array(s["input"])[-1, 0]) for s in self.clip(name)["samplers"])

    def local(self, clip: str | None, time: float) -> list[dict[str, np.ndarray]]:
        """Rotation and translation of each node."""
        nodes = [
            {"rotation": np.array(n.get("rotation", (0, 0, 0, 1.0))), "translation": np.array(n.get("translation", (0, 0, 0.0)))}
            for n in self.document["nodes"]
        ]  # fmt: skip
        if clip is None:
            return nodes
        animation = self.clip(clip)
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            times, values = self.array(sampler["input"])[:, 0], self.array(sampler["output"]).astype(np.float64)
            target, path = channel["target"]["node"], channel["target"]["path"]
            if path == "rotation":
                nodes[target][path] = Slerp(times, Rotation.from_quat(values))(time).as_quat()
            else:
                nodes[target][path] = np.array([np.interp(time, times, column) for column in values.T])
        return nodes

    def world(self, clip: str | None = None, time: float = 0.0) -> np.ndarray:
        """Matrix of each node."""
        local = self.local(clip, time)
        matrices = np.zeros((len(local), 4, 4))

        def visit(node: int, above: np.ndarray) -> None:
            own = np.eye(4)
            own[:3, :3] = Rotation.from_quat(local[node]["rotation"]).as_matrix()
            own[:3, 3] = local[node]["translation"]
            matrices[node] = above @ own
            for child in self.document["nodes"][node].get("children", ()):
                visit(child, matrices[node])

        for root in self.document["scenes"][0]["nodes"]:
            visit(root, np.eye(4))
        return matrices

    def vertices(self, clip: str | None = None, time: float = 0.0) -> np.ndarray:
        """The skinned mesh."""
        skin = self.document["skins"][0]
        inverse = self.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2).astype(np.float64)
        moved = self.world(clip, time)[skin["joints"]] @ inverse
        positions = self.attribute("POSITION").astype(np.float64)
        joints, weights = self.attribute("JOINTS_0"), self.attribute("WEIGHTS_0").astype(np.float64)
        blended = np.einsum("vi,vijk->vjk", weights, moved[joints])
        return np.einsum("vjk,vk->vj", blended[:, :3, :3], positions) + blended[:, :3, 3]
