"""What every rasteriser backend offers. Frames and pixel centres are defined in ``docs/conventions.md``."""

from abc import ABC, abstractmethod

from jaxtyping import Float, Int
from torch import Tensor

from fauna.renderer.contour import Contour
from fauna.types import Fragments, Topology


class Renderer(ABC):
    """Differentiable rasteriser of a batch of meshes that share their faces.

    Triangles are two-sided; those with a vertex at w <= 0 or with a non-finite vertex are not drawn, there is no
    clipping. Coverage is constant under differentiation: gradients reach the geometry through the barycentrics and,
    at silhouettes, through :meth:`antialias`. All backends share one rule for silhouettes (``fauna.renderer.edges``).
    """

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
