"""The binary glTF container: chunks, accessors and embedded pictures (glTF 2.0, sections 3.6 and 4)."""

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Num

from fauna.errors import FaunaError

MAGIC, VERSION = b"glTF", 2
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MATRIX_ROWS = {"MAT2": 2, "MAT3": 3, "MAT4": 4}


@dataclass(frozen=True)
class Glb:
    """A parsed container.

    Attributes:
        path: for messages.
        document: the JSON chunk.
        binary: the binary chunk, buffer 0.
    """

    path: Path
    document: dict[str, Any]
    binary: bytes

    def error(self, expected: str, got: str) -> FaunaError:
        """A message about this file."""
        return FaunaError(f"{self.path} expects {expected}, got {got}; export it again as binary glTF 2.0 (.glb)")

    def entry(self, kind: str, index: Any) -> dict[str, Any]:
        """Element ``index`` of the array ``kind`` of the document.

        Raises:
            FaunaError: when there is none.
        """
        entries = self.document.get(kind, [])
        if not isinstance(index, int) or not isinstance(entries, list) or not 0 <= index < len(entries):
            raise self.error(f"an index into {kind}", repr(index))
        if not isinstance(entries[index], dict):
            raise self.error(f"an object at {kind}[{index}]", repr(entries[index])[:40])
        return entries[index]


def read_glb(path: Path) -> Glb:
    """Parse a ``.glb`` file.

    Raises:
        FaunaError: for a missing file, wrong magic or version, truncated chunks, broken JSON or required extensions.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FaunaError(f"{path} expects a readable .glb file, got {error.strerror}; check the path") from error
    glb = Glb(path, {}, b"")
    if len(content) < 20 or content[:4] != MAGIC:
        raise glb.error("the bytes 'glTF' at its start", repr(content[:4]))
    version, length = struct.unpack_from("<II", content, 4)
    if version != VERSION:
        raise glb.error("version 2", f"version {version}")
    if length > len(content):
        raise glb.error(f"{length} bytes, as its header says", f"{len(content)} (truncated)")
    chunks = _chunks(glb, content[:length])
    try:
        document = json.loads(chunks[JSON_CHUNK])
    except (KeyError, ValueError) as error:
        raise glb.error("a JSON chunk", f"none that can be read ({type(error).__name__})") from error
    if not isinstance(document, dict):
        raise glb.error("a JSON object", type(document).__name__)
    if document.get("extensionsRequired"):
        raise glb.error("no required extensions", ", ".join(map(str, document["extensionsRequired"])))
    return Glb(path, document, chunks.get(BINARY_CHUNK, b""))


def _chunks(glb: Glb, content: bytes) -> dict[int, bytes]:
    found: dict[int, bytes] = {}
    at = 12
    while at + 8 <= len(content):
        size, kind = struct.unpack_from("<II", content, at)
        if at + 8 + size > len(content):
            raise glb.error(f"a chunk of {size} bytes at byte {at}", f"{len(content) - at - 8} (truncated)")
        found.setdefault(kind, content[at + 8 : at + 8 + size])
        at += 8 + size
    return found


def buffer_view(glb: Glb, index: Any) -> bytes:
    """Bytes of a buffer view.

    Raises:
        FaunaError: when it leaves the binary chunk or lies in another file.
    """
    view = glb.entry("bufferViews", index)
    if view.get("buffer") != 0 or "uri" in glb.entry("buffers", 0):
        raise glb.error("all data in the file itself", f"bufferViews[{index}] in another buffer")
    start, size = view.get("byteOffset", 0), view.get("byteLength", 0)
    if start < 0 or size < 0 or start + size > len(glb.binary):
        raise glb.error(
            f"bufferViews[{index}] within {len(glb.binary)} bytes of binary data", f"bytes {start} to {start + size}"
        )
    return glb.binary[start : start + size]


def accessor(glb: Glb, index: Any) -> Num[np.ndarray, "..."]:
    """Values of an accessor.

    Args:
        glb: the file.
        index: of the accessor.

    Returns:
        (count,) for scalars, (count, width) for vectors, (count, n, n) for matrices (rows first); as stored, but normalised
        integers as float64 in [0, 1] or [-1, 1].

    Raises:
        FaunaError: for unknown types and data out of range.
    """
    entry = glb.entry("accessors", index)
    kind, component, count = entry.get("type"), entry.get("componentType"), entry.get("count")
    if kind not in WIDTHS or component not in COMPONENTS or not isinstance(count, int) or count < 1:
        raise glb.error(f"a type, componentType and count >= 1 in accessors[{index}]", f"{kind}, {component}, {count}")
    if kind in MATRIX_ROWS and component != 5126:  # smaller components pad their columns; nobody writes that
        raise glb.error(f"matrices of floats in accessors[{index}]", f"componentType {component}")
    dtype, width = np.dtype(COMPONENTS[component]).newbyteorder("<"), WIDTHS[kind]
    values = np.zeros((count, width), dtype)
    if "bufferView" in entry:
        stride = glb.entry("bufferViews", entry["bufferView"]).get("byteStride") or width * dtype.itemsize
        values = _strided(glb, index, entry["bufferView"], entry.get("byteOffset", 0), stride, (count, width), dtype)
    if "sparse" in entry:
        values = _sparse(glb, index, entry["sparse"], values)
    values = values.astype(COMPONENTS[component])
    if entry.get("normalized") and component != 5126:
        values = np.maximum(values / np.iinfo(COMPONENTS[component]).max, -1.0)
    if kind in MATRIX_ROWS:  # stored by columns
        return np.ascontiguousarray(values.reshape(count, MATRIX_ROWS[kind], -1).swapaxes(1, 2))
    return values[:, 0] if kind == "SCALAR" else values


def _strided(
    glb: Glb, index: Any, view: Any, offset: int, stride: int, shape: tuple[int, int], dtype: np.dtype
) -> np.ndarray:
    data = buffer_view(glb, view)
    row = shape[1] * dtype.itemsize
    needed = offset + (shape[0] - 1) * stride + row
    if offset < 0 or stride < row or needed > len(data):
        raise glb.error(f"accessors[{index}] within its {len(data)} bytes", f"a reach of {needed}")
    return np.ndarray(shape, dtype, data, offset, (stride, dtype.itemsize)).copy()


def _sparse(glb: Glb, index: Any, sparse: dict[str, Any], values: np.ndarray) -> np.ndarray:
    """Replace the rows that a sparse accessor names."""
    count, places, rows = sparse["count"], sparse["indices"], sparse["values"]
    kind = np.dtype(COMPONENTS[places["componentType"]]).newbyteorder("<")
    at = _strided(glb, index, places["bufferView"], places.get("byteOffset", 0), kind.itemsize, (count, 1), kind)[:, 0]
    if at.max(initial=0) >= len(values):
        raise glb.error(f"sparse indices of accessors[{index}] below {len(values)}", str(at.max()))
    stride = values.shape[1] * values.dtype.itemsize
    shape = (count, values.shape[1])
    values[at] = _strided(glb, index, rows["bufferView"], rows.get("byteOffset", 0), stride, shape, values.dtype)
    return values
