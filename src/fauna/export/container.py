"""The binary glTF container, written (glTF 2.0, sections 3.6 and 4); :mod:`fauna.models3d.glb` reads it."""

import json
import struct
from typing import Any, Literal

import numpy as np
from jaxtyping import Num

from fauna.models3d.glb import BINARY_CHUNK, COMPONENTS, JSON_CHUNK, MAGIC, VERSION

ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
_CODES = {np.dtype(kind): code for code, kind in COMPONENTS.items()}
_KINDS = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}

Usage = Literal["vertices", "faces", "data"]
_TARGETS: dict[Usage, int | None] = {"vertices": ARRAY_BUFFER, "faces": ELEMENT_ARRAY_BUFFER, "data": None}


class Container:
    """Collects binary data and the document that describes it.

    Attributes:
        document: the JSON part; ``buffers``, ``bufferViews`` and ``accessors`` are kept by :meth:`add`.
    """

    def __init__(self, document: dict[str, Any]) -> None:
        self.document = document | {"accessors": [], "bufferViews": []}
        self._parts: list[bytes] = []
        self._length = 0

    def add(self, values: Num[np.ndarray, "count ..."], *, usage: Usage) -> int:
        """Store an array.

        Args:
            values: of a component type of glTF; matrices with rows first; rows of vertex data of 4, 8, ... bytes.
            usage: what reads it.

        Returns:
            Index of the accessor, which states the extremes of each component.
        """
        count, shape = len(values), values.shape[1:]
        columns = values.swapaxes(1, 2) if len(shape) == 2 else values
        flat = np.ascontiguousarray(columns).reshape(count, -1)
        little = flat.astype(flat.dtype.newbyteorder("<"), copy=False)
        accessor = {
            "bufferView": self.view(little.tobytes(), usage=usage),
            "componentType": _CODES[values.dtype],
            "count": count,
            "type": _KINDS[shape],
            "min": flat.min(axis=0).tolist(),
            "max": flat.max(axis=0).tolist(),
        }
        return self._append("accessors", accessor)

    def view(self, content: bytes, *, usage: Usage) -> int:
        """Store bytes at a multiple of 4; the index of the buffer view."""
        view: dict[str, Any] = {"buffer": 0, "byteOffset": self._length, "byteLength": len(content)}
        target = _TARGETS[usage]
        if target is not None:
            view["target"] = target
        padded = content + bytes(-len(content) % 4)
        self._parts.append(padded)
        self._length += len(padded)
        return self._append("bufferViews", view)

    def to_bytes(self) -> bytes:
        """The file."""
        document = self.document | {"buffers": [{"byteLength": self._length}]}
        text = json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        binary = b"".join(self._parts)
        length = 12 + 8 + len(text) + 8 + len(binary)
        head = MAGIC + struct.pack("<II", VERSION, length)
        return head + _chunk(JSON_CHUNK, text) + _chunk(BINARY_CHUNK, binary)

    def _append(self, kind: str, entry: dict[str, Any]) -> int:
        self.document[kind].append(entry)
        return len(self.document[kind]) - 1


def _chunk(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", len(content), kind) + content
