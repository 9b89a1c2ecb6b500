"""Colours that can be laid on another body: a cloud of coloured points, found again by their place in the bounding box.

Meshes of different shape codes have nothing in common but the canonical frame (y up, head at +z, mirror plane x = 0). A point is
looked up at the same relative place between toes and back, rump and muzzle, which matches legs with legs and heads with heads. Colours of two animals are
cross-faded; each keeps what its own photograph showed, as the texture has it.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from scipy.spatial import KDTree
from torch import Tensor

from fauna.reconstruct.result import Fit, Result
from fauna.reconstruct.traits import Body
from fauna.renderer.base import Renderer
from fauna.texture.atlas import Atlas, fill, texels_of, unwrap
from fauna.texture.baking import albedo_at
from fauna.texture.visible import texture_embedding

POINTS = 60_000
"""Texels of a texture that are kept, at most."""
NEIGHBOURS = 3
"""Points whose colours are mixed, weighed by 1 / distance."""


@dataclass(frozen=True, eq=False)
class Coat:
    """Coloured points of a body.

    Attributes:
        places: (point, 3) in the bounding box of the base shape, each axis from -1 to 1.
        colours: (point, 3) sRGB in [0, 1].
    """

    places: Float[np.ndarray, "point 3"]
    colours: Float[np.ndarray, "point 3"]

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.places)

    def at(self, places: Float[np.ndarray, "place 3"]) -> Float[np.ndarray, "place 3"]:
        """Colours at places in the bounding box."""
        distance, point = self._tree.query(places, k=min(NEIGHBOURS, len(self.places)))
        distance, point = distance.reshape(len(places), -1), point.reshape(len(places), -1)
        weights = 1.0 / (distance + 1e-6)
        return np.einsum("pk,pkc->pc", weights / weights.sum(axis=1, keepdims=True), self.colours[point])


@dataclass(frozen=True)
class PaintedAtlas:
    """A UV atlas and its picture, for export (:class:`fauna.export.UvTexture`).

    Attributes:
        vertex: mesh vertex of each UV vertex.
        faces: UV vertices of each face.
        uv: in [0, 1], origin top left.
        image: 8-bit sRGB.
    """

    vertex: Int[np.ndarray, " uv_vert"]
    faces: Int[np.ndarray, "face 3"]
    uv: Float[np.ndarray, "uv_vert 2"]
    image: UInt8[np.ndarray, "size size 3"]


def coat_of(result: Result, fit: Fit) -> Coat:
    """Colours of a reconstruction: those of its texture, or of the network at its vertices where it has none."""
    base = fit.out.base
    texture = result.texture
    if texture is None:
        colours = albedo_at(fit.model.appearance, base.verts, texture_embedding(fit.out)[:1])
        return Coat(in_box(base.verts, base.verts), colours.double().cpu().numpy())
    atlas = Atlas(*(torch.from_numpy(each) for each in (texture.vertex, texture.faces, texture.uv)))
    size = texture.image.shape[0]
    texels = texels_of(fit.model.renderer, atlas, size)
    points = texels.interpolate(base.verts.detach().cpu())
    step = max(1, len(points) // POINTS)
    colours = texture.image.reshape(-1, 3)[texels.index.numpy()[::step]] / 255.0
    return Coat(in_box(points[::step], base.verts), colours)


def in_box(points: Float[Tensor, "point 3"], verts: Float[Tensor, "vert 3"]) -> Float[np.ndarray, "point 3"]:
    """Places of points in the bounding box of a base shape, each axis from -1 to 1."""
    low, high = verts.detach().amin(dim=0), verts.detach().amax(dim=0)
    half = (0.5 * (high - low)).clamp_min(1e-6)
    return ((points.detach() - 0.5 * (low + high)) / half).double().cpu().numpy()


def crossfaded(
    first: Coat, second: Coat, share: float, places: Float[np.ndarray, "place 3"]
) -> Float[np.ndarray, "place 3"]:
    """Colours between two coats; a share of 0 or 1 asks one of them only."""
    if share in (0.0, 1.0):
        return (second if share else first).at(places)
    return (1.0 - share) * first.at(places) + share * second.at(places)


def painted(renderer: Renderer, body: Body, first: Coat, second: Coat, share: float, *, size: int) -> PaintedAtlas:
    """A texture for a body between two animals.

    Args:
        renderer: draws the charts.
        body: at the same share.
        first: coat of the first animal.
        second: of the second.
        share: of the second.
        size: side of the picture, texels.
    """
    atlas = unwrap(body.instance.verts[0], body.base.faces, body.base.topology, size=size)
    texels = texels_of(renderer, atlas, size)
    places = in_box(texels.interpolate(body.base.verts), body.base.verts)
    image, known = np.zeros((size * size, 3), np.uint8), np.zeros(size * size, bool)
    index = texels.index.cpu().numpy()
    image[index] = (crossfaded(first, second, share, places).clip(0, 1) * 255).round()
    known[index] = True
    vertex, faces, uv = (each.cpu().numpy() for each in (atlas.vertex, atlas.faces, atlas.uv))
    return PaintedAtlas(vertex, faces, uv, fill(image.reshape(size, size, 3), known.reshape(size, size)))
