"""What the backends demand of their inputs. Bounds of index tensors are looked up once per tensor."""

import torch
from torch import Tensor

from fauna.errors import FaunaError
from fauna.geometry.mesh import index_bounds
from fauna.types import Fragments, Topology


def check_mesh(clip_verts: Tensor, faces: Tensor, height: int, width: int) -> None:
    """Reject what would index out of range or lose precision silently.

    Raises:
        FaunaError: see :meth:`fauna.renderer.base.Renderer.rasterize`.
    """
    if clip_verts.dtype not in (torch.float32, torch.float64):
        raise FaunaError(f"clip_verts must be float32 or float64, got {clip_verts.dtype}; cast before rasterising")
    if height < 1 or width < 1:
        raise FaunaError(f"image size must be positive, got {height} x {width}; set height and width")
    low, high = index_bounds(faces)
    if low < 0 or high >= clip_verts.shape[1]:
        count = clip_verts.shape[1]
        raise FaunaError(f"faces must index {count} vertices, got indices {low}..{high}; pass the mesh's own faces")


def check_attributes(fragments: Fragments, faces: Tensor, attributes: Tensor) -> Tensor:
    """Attributes in the precision of the barycentrics.

    Raises:
        FaunaError: the leading axis is neither 1 nor the number of rows, or a face has no attributes.
    """
    rows = fragments.face_index.shape[0]
    if attributes.shape[0] not in (1, rows):
        raise FaunaError(f"attributes must have 1 or {rows} rows, got {attributes.shape[0]}; repeat them per row")
    high = index_bounds(faces)[1]
    if high >= attributes.shape[1]:
        count = attributes.shape[1]
        raise FaunaError(f"attributes must cover vertex {high}, got {count} vertices; pass one per vertex")
    return attributes.to(fragments.barycentrics.dtype)


def check_topology(topology: Topology, clip_verts: Tensor, faces: Tensor) -> None:
    """Reject the edges of another mesh.

    Raises:
        FaunaError: an edge refers to a vertex or a face that does not exist.
    """
    for name, index, count in (
        ("vertices", topology.edges, clip_verts.shape[1]),
        ("faces", topology.edge_faces, len(faces)),
    ):
        high = index_bounds(index)[1]
        if high >= count:
            raise FaunaError(f"topology must refer to the mesh's {count} {name}, got index {high}; rebuild it")


def check_pixels(fragments: Fragments, pixels: Tensor) -> None:
    """Reject pixel indices outside the images.

    Raises:
        FaunaError: an index is negative or too large.
    """
    count = fragments.face_index.numel()
    low, high = index_bounds(pixels)
    if low < 0 or high >= count:
        raise FaunaError(
            f"pixels must lie in 0..{count - 1}, got {low}..{high}; pass flat (row, height, width) indices"
        )
