"""Deferred shading: rasterise -> contours and silhouette -> fields at the pixels that matter -> shade -> antialias."""

from collections.abc import Callable
from typing import Literal

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fauna.appearance.base import Appearance
from fauna.appearance.shading import shade
from fauna.geometry.camera import to_clip
from fauna.geometry.mesh import build_topology, face_normals, vertex_normals
from fauna.renderer.base import Renderer
from fauna.renderer.contour import Contour, blend_at, blend_coverage
from fauna.types import Camera, Fragments, Light, PosedMesh, Renders, Shading, Topology

FeatureLookup = Literal["vertices", "pixels"]
Wanted = Callable[[Float[Tensor, "row height width"]], Bool[Tensor, "row height width"]]
"""Silhouette -> pixels whose colour somebody will look at."""


def render(
    renderer: Renderer,
    posed: PosedMesh,
    topology: Topology,
    camera: Camera,
    size: tuple[int, int],
    *,
    appearance: Appearance,
    texture: Float[Tensor, "row texture_chan"],
    code: Float[Tensor, " value_chan"],
    light: Light,
    feature_lookup: FeatureLookup,
    wanted: Wanted | None,
    share: float,
    generator: torch.Generator | None,
) -> Renders:
    """Silhouette everywhere, shaded colour and features where they are wanted (Sec. 3.1, "Appearance").

    Fields are looked up at the canonical (base-shape) position of a pixel. ``feature_lookup="vertices"`` evaluates the
    feature field once per vertex for all rows and interpolates; ``"pixels"`` evaluates it at every listed pixel.

    Args:
        renderer: rasteriser.
        posed: skinned mesh of each row.
        topology: edges of its faces.
        camera: of each row.
        size: height and width of the images, pixels.
        appearance: the fields.
        texture: texture embedding of each row.
        code: shape code, the condition of the feature field.
        light: of each row.
        feature_lookup: see above.
        wanted: the pixels to shade; ``None`` = all that show something of the mesh.
        share: expected share of the wanted pixels that is shaded, drawn independently; 1 = all.
        generator: of that draw; needed when ``share`` is below 1.
    """
    view = _camera_points(posed.verts, camera)
    clip = to_clip(posed.verts, camera.clip_from_world)
    fragments = renderer.rasterize(clip, posed.faces, *size)
    contour = renderer.contour(fragments, clip, posed.faces, topology)
    silhouette = blend_coverage(fragments.covered, contour).to(clip.dtype)
    chosen = _choose(fragments, contour, None if wanted is None else wanted(silhouette), share, generator)
    pixels = _with_neighbours(chosen, contour).nonzero()[:, 0]
    row = pixels // (size[0] * size[1])
    attributes = torch.cat((vertex_normals(view, posed.faces), view), dim=2)
    geometry = renderer.interpolate_at(fragments, posed.faces, attributes, pixels)
    shared = posed.canonical
    if feature_lookup == "vertices":
        shared = torch.cat((shared, appearance.features(posed.canonical, code)), dim=1)
    fields = renderer.interpolate_at(fragments, posed.faces, shared[None], pixels)
    points = fields[:, :3]
    features = fields[:, 3:] if feature_lookup == "vertices" else appearance.features(points, code)
    flat = face_normals(view, posed.faces)[row, fragments.face_index.reshape(-1)[pixels]]
    rgb = shade(appearance.albedo(points, texture, row), geometry[:, :3], flat, -geometry[:, 3:], light, row)
    values = torch.cat((rgb, features), dim=1) * fragments.covered.reshape(-1)[pixels][:, None]
    values = blend_at(values, pixels, contour, silhouette.numel())
    listed = chosen[pixels].nonzero()[:, 0]
    values = values.index_select(0, listed)
    shading = Shading(pixels[listed], row[listed], values[:, :3], values[:, 3:], share)
    return Renders(silhouette=silhouette, covered=fragments.covered, shading=shading)


def render_silhouette(
    renderer: Renderer,
    posed: PosedMesh,
    camera: Camera,
    size: tuple[int, int],
    *,
    topology: Topology | None = None,
) -> Float[Tensor, "row height width"]:
    """Antialiased coverage only: the fast path of random views. ``topology`` is found anew when it is not at hand."""
    clip = to_clip(posed.verts, camera.clip_from_world)
    return renderer.silhouette(clip, posed.faces, *size, build_topology(posed.faces) if topology is None else topology)


def _choose(
    fragments: Fragments,
    contour: Contour,
    wanted: Bool[Tensor, "row height width"] | None,
    share: float,
    generator: torch.Generator | None,
) -> Bool[Tensor, " all"]:
    """Pixels that will be listed, as flags over (row, height, width)."""
    if wanted is None:
        chosen = fragments.covered.reshape(-1).clone()
        chosen[contour.target] = True
    else:
        chosen = wanted.reshape(-1)
    if share < 1:
        assert generator is not None, "a random share of the pixels needs a generator"
        chosen = chosen & (torch.rand(chosen.shape, generator=generator) < share).to(chosen.device)
    return chosen


def _with_neighbours(chosen: Bool[Tensor, " all"], contour: Contour) -> Bool[Tensor, " all"]:
    """Add the pixels whose colour reaches a chosen one across a contour."""
    reached = chosen.new_zeros(chosen.shape, dtype=torch.int32)
    return chosen | (reached.index_add(0, contour.source, chosen[contour.target].int()) > 0)


def _camera_points(verts: Float[Tensor, "row vert 3"], camera: Camera) -> Float[Tensor, "row vert 3"]:
    matrix = camera.camera_from_world
    return torch.baddbmm(matrix[:, None, :3, 3], verts, matrix[:, :3, :3].transpose(1, 2))
