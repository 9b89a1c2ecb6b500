"""The default backend: compiled kernels on CPU, torch elsewhere."""

import warnings

from jaxtyping import Float, Int
from torch import Tensor

from fauna.renderer.base import Renderer
from fauna.renderer.contour import Contour
from fauna.renderer.torch_backend import TorchRenderer
from fauna.types import Fragments, Topology


class NumbaRenderer(Renderer):
    """Draws CPU tensors in numba kernels; CUDA tensors, or any when numba is missing, by :class:`TorchRenderer`."""

    def __init__(self):
        """Warns if numba is missing."""
        self._torch = TorchRenderer()
        self._cpu = _compiled() or self._torch

    def rasterize(
        self, clip_verts: Float[Tensor, "row vert 4"], faces: Int[Tensor, "face 3"], height: int, width: int
    ) -> Fragments:
        """See :meth:`Renderer.rasterize`."""
        return self._backend(clip_verts).rasterize(clip_verts, faces, height, width)

    def interpolate(
        self,
        fragments: Fragments,
        faces: Int[Tensor, "face 3"],
        attributes: Float[Tensor, "row_or_1 vert chan"],
    ) -> Float[Tensor, "row chan height width"]:
        """See :meth:`Renderer.interpolate`."""
        return self._backend(attributes).interpolate(fragments, faces, attributes)

    def interpolate_at(
        self,
        fragments: Fragments,
        faces: Int[Tensor, "face 3"],
        attributes: Float[Tensor, "row_or_1 vert chan"],
        pixels: Int[Tensor, " pixel"],
    ) -> Float[Tensor, "pixel chan"]:
        """See :meth:`Renderer.interpolate_at`."""
        return self._backend(attributes).interpolate_at(fragments, faces, attributes, pixels)

    def antialias(
        self,
        image: Float[Tensor, "row chan height width"],
        fragments: Fragments,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        topology: Topology,
    ) -> Float[Tensor, "row chan height width"]:
        """See :meth:`Renderer.antialias`."""
        return self._backend(image).antialias(image, fragments, clip_verts, faces, topology)

    def contour(
        self,
        fragments: Fragments,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        topology: Topology,
    ) -> Contour:
        """See :meth:`Renderer.contour`."""
        return self._backend(clip_verts).contour(fragments, clip_verts, faces, topology)

    def silhouette(
        self,
        clip_verts: Float[Tensor, "row vert 4"],
        faces: Int[Tensor, "face 3"],
        height: int,
        width: int,
        topology: Topology,
    ) -> Float[Tensor, "row height width"]:
        """See :meth:`Renderer.silhouette`."""
        return self._backend(clip_verts).silhouette(clip_verts, faces, height, width, topology)

    def _backend(self, tensor: Tensor) -> Renderer:
        return self._cpu if tensor.device.type == "cpu" else self._torch


def _compiled() -> Renderer | None:
    """The kernels' renderer, or ``None`` and a warning when numba cannot be imported."""
    try:
        from fauna.renderer.compiled import CompiledRenderer
    except ImportError:
        warnings.warn(
            "numba is not installed: rendering in torch, several times slower; pip install numba", stacklevel=3
        )
        return None
    return CompiledRenderer()
