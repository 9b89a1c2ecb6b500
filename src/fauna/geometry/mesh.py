"""Triangle meshes: edges, normals, areas. On CPU the loops over faces run in numba kernels when numba is installed."""

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.utils.weak import WeakTensorKeyDictionary

from fauna.errors import FaunaError
from fauna.types import Topology

try:
    from fauna.kernels import mesh as kernels
except ImportError:
    kernels = None

MIN_SQUARED_LENGTH = 1e-20  # of a normal before normalisation, (twice the area)^2
_known_bounds = WeakTensorKeyDictionary()  # tensor -> (version, bounds)


def index_bounds(index: Int[Tensor, "*shape"]) -> tuple[int, int]:
    """Least and greatest index, (0, -1) of none.

    Remembered for each tensor until it is changed in place: a mesh is checked once, however often it is drawn, and a
    GPU is waited for once.
    """
    if not index.numel():
        return 0, -1
    version = -1 if index.is_inference() else index._version
    known = _known_bounds.get(index)
    if known is not None and version >= 0 and known[0] == version:
        return known[1]
    low, high = torch.stack(torch.aminmax(index)).tolist()
    _known_bounds[index] = (version, (low, high))
    return low, high


def build_topology(faces: Int[Tensor, "face 3"]) -> Topology:
    """Edges of a mesh and their adjacent faces.

    Args:
        faces: vertex indices. Of an edge with more than two faces the first two are kept; sides of zero length
            (a face with a repeated index) are no edges.

    Returns:
        Topology with edges in lexicographic order and the faces of each in ascending order.
    """
    if not len(faces):
        empty = faces.new_zeros(0, 2, dtype=torch.long)
        return Topology(empty, empty.clone())
    faces = faces.long()
    if kernels is not None and faces.device.type == "cpu":
        edges, edge_faces = kernels.edge_list(faces.contiguous().numpy(), index_bounds(faces)[1] + 1)
        return Topology(torch.from_numpy(edges), torch.from_numpy(edge_faces))
    return _build_topology_torch(faces)


def _build_topology_torch(faces: Tensor) -> Topology:
    """Sort the three sides of all faces by their end points and merge equal neighbours."""
    sides = torch.stack((faces, faces.roll(-1, dims=1)), dim=2).reshape(-1, 2).sort(dim=1).values  # (3 face, 2)
    owner = torch.arange(len(faces), device=faces.device).repeat_interleave(3)
    proper = sides[:, 0] != sides[:, 1]
    sides, owner = sides[proper], owner[proper]
    base = faces.max() + 1
    key, order = (sides[:, 0] * base + sides[:, 1]).sort(stable=True)
    unique, counts = torch.unique_consecutive(key, return_counts=True)
    owner, first = owner[order], counts.cumsum(0) - counts
    second = torch.where(counts > 1, owner[(first + 1).clamp(max=len(owner) - 1)], -1)
    edges = torch.stack((torch.div(unique, base, rounding_mode="floor"), unique % base), dim=1)
    return Topology(edges, torch.stack((owner[first], second), dim=1))


def face_normals(verts: Float[Tensor, "batch vert 3"], faces: Int[Tensor, "face 3"]) -> Float[Tensor, "batch face 3"]:
    """Unit normals, outward for counter-clockwise faces; (0, 0, 1) for degenerate ones."""
    return _normalize(_area_vectors(verts, faces))


def face_areas(verts: Float[Tensor, "batch vert 3"], faces: Int[Tensor, "face 3"]) -> Float[Tensor, "batch face"]:
    """Areas of the faces, squared world units; differentiable also at zero area."""
    doubled = _area_vectors(verts, faces)
    square = doubled.square().sum(dim=-1)
    degenerate = square <= MIN_SQUARED_LENGTH
    return 0.5 * torch.where(degenerate, 1.0, square).sqrt().masked_fill(degenerate, 0.0)


def vertex_normals(verts: Float[Tensor, "batch vert 3"], faces: Int[Tensor, "face 3"]) -> Float[Tensor, "batch vert 3"]:
    """Unit normals: mean of the adjacent faces' normals weighted by area; (0, 0, 1) where that is undefined.

    Args:
        verts: positions, differentiable.
        faces: counter-clockwise seen from outside, shared by the batch.

    Raises:
        FaunaError: a face refers to a vertex that does not exist.
    """
    count, highest = verts.shape[1], index_bounds(faces)[1]
    if highest >= count:
        raise FaunaError(f"faces must index {count} vertices, got index {highest}; pass the mesh's own faces")
    if kernels is not None and verts.device.type == "cpu" and verts.dtype in (torch.float32, torch.float64):
        return _normalize(_SumFaceNormals.apply(verts, faces.long()))
    corners = faces.reshape(-1)
    per_corner = _area_vectors(verts, faces).repeat_interleave(3, dim=1)
    return _normalize(torch.zeros_like(verts).index_add(1, corners, per_corner))


def _area_vectors(verts: Tensor, faces: Tensor) -> Tensor:
    """Cross products (batch, face, 3) of two sides: twice the area times the unit normal."""
    a, b, c = (verts.index_select(1, faces[:, k]) for k in range(3))
    return torch.linalg.cross(b - a, c - a)


def _normalize(vectors: Tensor) -> Tensor:
    """Unit vectors along the last axis; (0, 0, 1), without gradient, where the length vanishes."""
    square = vectors.square().sum(dim=-1, keepdim=True)
    degenerate = square <= MIN_SQUARED_LENGTH
    unit = vectors * torch.where(degenerate, 1.0, square).rsqrt()
    fallback = (torch.arange(3, device=vectors.device) == 2).to(vectors.dtype)
    return torch.where(degenerate, fallback, unit)


class _SumFaceNormals(torch.autograd.Function):
    """(verts, faces) -> sum over adjacent faces of their area vectors."""

    @staticmethod
    def forward(ctx, verts, faces):
        assert kernels is not None
        ctx.save_for_backward(verts, faces)
        return torch.from_numpy(kernels.sum_face_normals(*_arrays(verts, faces)))

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # pyright: ignore[reportIncompatibleMethodOverride]
        assert kernels is not None
        verts, faces = ctx.saved_tensors
        return torch.from_numpy(kernels.sum_face_normals_backward(*_arrays(verts, faces, grads[0]))), None


def _arrays(*tensors: Tensor):
    return (tensor.detach().contiguous().numpy() for tensor in tensors)
