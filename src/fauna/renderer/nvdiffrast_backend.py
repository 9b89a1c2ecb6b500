"""CUDA backend: coverage and interpolation by nvdiffrast, silhouettes by our own edges."""

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fauna.errors import FaunaError
from fauna.renderer.base import Renderer
from fauna.renderer.checks import check_attributes, check_mesh
from fauna.renderer.contour import Contour
from fauna.renderer.torch_backend import TorchRenderer
from fauna.types import Fragments, Topology


class NvdiffrastRenderer(Renderer):
    """Rasterises with the optional package nvdiffrast (Laine et al. 2020) on CUDA tensors.

    Its own antialiasing is not used: it only sees edges of the triangles found at pixel centres and loses most of
    the silhouette gradient when triangles are about pixel-sized.
    """

    def __init__(self):
        """Open nvdiffrast's CUDA context.

        Raises:
            FaunaError: nvdiffrast or CUDA is missing.
        """
        if not torch.cuda.is_available():
            raise FaunaError(
                "renderer=nvdiffrast needs a CUDA device, found none; use renderer=numba or renderer=torch"
            )
        try:
            import nvdiffrast.torch as nvdiffrast  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            message = "renderer=nvdiffrast needs the package nvdiffrast, which is not installed; use renderer=torch"
            raise FaunaError(message) from error
        self._nvdiffrast = nvdiffrast
        self._context = nvdiffrast.RasterizeCudaContext()
        self._torch = TorchRenderer()

    def rasterize(
        self, clip_verts: Float[Tensor, "row vert 4"], faces: Int[Tensor, "face 3"], height: int, width: int
    ) -> Fragments:
        """See :meth:`Renderer.rasterize`. Its row 0 is at NDC y = -1, which is our top row: nothing is flipped."""
        check_mesh(clip_verts, faces, height, width)
        buffer, _ = self._nvdiffrast.rasterize(
            self._context, clip_verts.float().contiguous(), faces.int().contiguous(), (height, width)
        )
        face_index = buffer[..., 3].detach().long() - 1
        covered = face_index >= 0
        u, v = buffer[..., 0], buffer[..., 1]
        weights = torch.stack((u, v, 1 - u - v), dim=-1) * covered[..., None]
        depth = buffer[..., 2].detach().masked_fill(~covered, torch.inf)
        return Fragments(face_index, weights.to(clip_verts.dtype), depth.to(clip_verts.dtype))

    def interpolate(
        self,
        fragments: Fragments,
        faces: Int[Tensor, "face 3"],
        attributes: Float[Tensor, "row_or_1 vert chan"],
    ) -> Float[Tensor, "row chan height width"]:
        """See :meth:`Renderer.interpolate`."""
        attributes = check_attributes(fragments, faces, attributes).float().contiguous()
        u, v, _ = fragments.barycentrics.float().unbind(-1)
        ids = fragments.face_index.float() + 1
        buffer = torch.stack((u, v, torch.zeros_like(u), ids), dim=-1)
        image, _ = self._nvdiffrast.interpolate(attributes, buffer, faces.int().contiguous())
        return image.movedim(-1, 1).contiguous().to(fragments.barycentrics.dtype)

    def interpolate_at(
        self,
        fragments: Fragments,
        faces: Int[Tensor, "face 3"],
        attributes: Float[Tensor, "row_or_1 vert chan"],
        pixels: Int[Tensor, " pixel"],
    ) -> Float[Tensor, "pixel chan"]:
        """See :meth:`Renderer.interpolate_at`."""
        return self._torch.interpolate_at(fragments, faces, attributes, pixels)

    def antialias(
        self,
        image: Float[Tensor, "row chan height width"],
        fragments: Fragments,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        topology: Topology,
    ) -> Float[Tensor, "row chan height width"]:
        """See :meth:`Renderer.antialias`."""
        return self._torch.antialias(image, fragments, clip_verts, faces, topology)

    def contour(
        self,
        fragments: Fragments,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        topology: Topology,
    ) -> Contour:
        """See :meth:`Renderer.contour`."""
        return self._torch.contour(fragments, clip_verts, faces, topology)

    def silhouette(
        self,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        height: int,
        width: int,
        topology: Topology,
    ) -> Float[Tensor, "row height width"]:
        """See :meth:`Renderer.silhouette`."""
        fragments = self.rasterize(clip_verts.detach(), faces, height, width)
        coverage = fragments.covered[:, None].to(clip_verts.dtype)
        return self.antialias(coverage, fragments, clip_verts, faces, topology).squeeze(1).clamp(0, 1)
