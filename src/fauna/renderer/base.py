"""What every rasteriser backend offers. Frames and pixel centres are defined in ``docs/conventions.md``."""

from abc import ABC, abstractmethod

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fauna.errors import FaunaError
from fauna.renderer.contour import Contour
from fauna.types import Fragments, Topology


class Renderer(ABC):
    """Differentiable rasteriser of a batch of meshes that share their faces.

    Triangles are two-sided; those with a vertex at w <= 0 or with a non-finite vertex are not drawn, there is no
    clipping. Coverage is constant under differentiation: gradients reach the geometry through the barycentrics and,
    at silhouettes, through :meth:`antialias`. All backends share one rule for silhouettes (``fauna.renderer.edges``).
    """

    def __init__(self, *, soft_edges: bool):
        """Create a renderer.

        Args:
            soft_edges: sample silhouette edges on pixel rows *and* columns, weighted by slope, instead of on the
                steeper axis only. Less noisy gradients, slightly worse images.
        """
        self.soft_edges = soft_edges

    @abstractmethod
    def rasterize(
        self, clip_verts: Float[Tensor, "row vert 4"], faces: Int[Tensor, "face 3"], height: int, width: int
    ) -> Fragments:
        """Nearest triangle at every pixel centre.

        Args:
            clip_verts: homogeneous clip positions, NDC y down, float32 or float64.
            faces: vertex indices shared by all rows.
            height: of the image, pixels.
            width: of the image, pixels.

        Returns:
            Fragments whose barycentrics are differentiable to x, y and w of ``clip_verts``. The nearest triangle has
            the least z / w; of equally near ones the first in ``faces`` is taken.

        Raises:
            FaunaError: the inputs are of a wrong type or index vertices that do not exist.
        """

    @abstractmethod
    def interpolate(
        self,
        fragments: Fragments,
        faces: Int[Tensor, "face 3"],
        attributes: Float[Tensor, "row_or_1 vert chan"],
    ) -> Float[Tensor, "row chan height width"]:
        """Image of vertex attributes, 0 on background; differentiable to attributes and barycentrics.

        Args:
            fragments: of :meth:`rasterize`.
            faces: the faces that were rasterised.
            attributes: one set per row, or a single one shared by all rows.
        """

    @abstractmethod
    def interpolate_at(
        self,
        fragments: Fragments,
        faces: Int[Tensor, "face 3"],
        attributes: Float[Tensor, "row_or_1 vert chan"],
        pixels: Int[Tensor, " pixel"],
    ) -> Float[Tensor, "pixel chan"]:
        """As :meth:`interpolate` at some pixels, given as flat indices into (row, height, width)."""

    @abstractmethod
    def antialias(
        self,
        image: Float[Tensor, "row chan height width"],
        fragments: Fragments,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        topology: Topology,
    ) -> Float[Tensor, "row chan height width"]:
        """Blend neighbouring pixels across silhouettes; differentiable to the image and to ``clip_verts``.

        The blend is linear in the image. Where several contours meet in a pixel it may overshoot the range of
        the image, so coverage is to be clamped to [0, 1] as :meth:`silhouette` does.
        """

    @abstractmethod
    def contour(
        self,
        fragments: Fragments,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        topology: Topology,
    ) -> Contour:
        """Which neighbouring pixels silhouette edges separate, and what share of one shines into the other.

        :meth:`antialias` applies it to images; ``fauna.renderer.contour`` to coverages and lists of pixels.
        """

    @abstractmethod
    def silhouette(
        self,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        height: int,
        width: int,
        topology: Topology,
    ) -> Float[Tensor, "row height width"]:
        """Antialiased coverage in [0, 1], differentiable to ``clip_verts``.

        Equal to rasterising, antialiasing the coverage and clamping, without depth test and barycentrics.
        """


def check_mesh(clip_verts: Tensor, faces: Tensor, height: int, width: int) -> None:
    """Reject what would index out of range or lose precision silently.

    Raises:
        FaunaError: see :meth:`Renderer.rasterize`.
    """
    if clip_verts.dtype not in (torch.float32, torch.float64):
        raise FaunaError(f"clip_verts must be float32 or float64, got {clip_verts.dtype}; cast before rasterising")
    if height < 1 or width < 1:
        raise FaunaError(f"image size must be positive, got {height} x {width}; set height and width")
    if faces.numel():
        low, high = (int(bound) for bound in torch.aminmax(faces))
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
    if faces.numel() and int(faces.max()) >= attributes.shape[1]:
        count = attributes.shape[1]
        raise FaunaError(f"attributes must cover vertex {int(faces.max())}, got {count} vertices; pass one per vertex")
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
        if index.numel() and int(index.max()) >= count:
            message = f"topology must refer to the mesh's {count} {name}, got index {int(index.max())}; rebuild it"
            raise FaunaError(message)
