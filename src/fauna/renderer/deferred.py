"""Deferred shading: rasterise -> look fields up where the mesh is seen -> shade -> composite over black -> antialias."""

from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fauna.appearance.base import Appearance
from fauna.appearance.shading import shade
from fauna.geometry.camera import to_clip
from fauna.geometry.mesh import build_topology, face_normals, vertex_normals
from fauna.renderer.base import Renderer
from fauna.types import Camera, Fragments, Light, PosedMesh, Renders

FeatureLookup = Literal["vertices", "pixels"]


def render(
    renderer: Renderer,
    posed: PosedMesh,
    camera: Camera,
    size: tuple[int, int],
    *,
    appearance: Appearance,
    texture: Float[Tensor, "row texture_chan"],
    code: Float[Tensor, " value_chan"],
    light: Light,
    feature_lookup: FeatureLookup,
) -> Renders:
    """Silhouette, shaded colour and feature image of every row (Sec. 3.1, "Appearance").

    Fields are looked up at the canonical (base-shape) position of a pixel. ``feature_lookup="vertices"`` evaluates the
    feature field once per vertex for all rows and interpolates; ``"pixels"`` evaluates it at every covered pixel.
    """
    clip = to_clip(posed.verts, camera.clip_from_world)
    fragments = renderer.rasterize(clip, posed.faces, *size)
    pixels = fragments.covered.reshape(-1).nonzero()[:, 0]
    row = pixels // (size[0] * size[1])
    points = renderer.interpolate_at(fragments, posed.faces, posed.canonical[None], pixels)
    rgb = _shaded(renderer, posed, camera, fragments, pixels, row, appearance.albedo(points, texture, row), light)
    if feature_lookup == "vertices":
        field = appearance.features(posed.canonical, code)
        features = renderer.interpolate_at(fragments, posed.faces, field[None], pixels)
    else:
        features = appearance.features(points, code)
    ones = torch.ones_like(rgb[:, :1])
    flat = torch.cat([rgb, features, ones], dim=1)  # (pixel, 3 + chan + 1)
    image = _scatter(flat, pixels, clip.shape[0], size)
    topology = build_topology(posed.faces)
    image = renderer.antialias(image, fragments, clip, posed.faces, topology)
    return Renders(
        silhouette=image[:, -1].clamp(0.0, 1.0), covered=fragments.covered, rgb=image[:, :3], features=image[:, 3:-1]
    )


def render_silhouette(
    renderer: Renderer, posed: PosedMesh, camera: Camera, size: tuple[int, int]
) -> Float[Tensor, "row height width"]:
    """Antialiased coverage only: the fast path of random views."""
    clip = to_clip(posed.verts, camera.clip_from_world)
    return renderer.silhouette(clip, posed.faces, *size, build_topology(posed.faces))


def _shaded(
    renderer: Renderer,
    posed: PosedMesh,
    camera: Camera,
    fragments: Fragments,
    pixels: Int[Tensor, " pixel"],
    row: Int[Tensor, " pixel"],
    albedo: Float[Tensor, "pixel 3"],
    light: Light,
) -> Float[Tensor, "pixel 3"]:
    """Lambertian colour of the covered pixels."""
    face = fragments.face_index.reshape(-1)[pixels]
    smooth = vertex_normals(posed.verts, posed.faces)
    normal = renderer.interpolate_at(fragments, posed.faces, smooth, pixels)
    flat = face_normals(posed.verts, posed.faces)[row, face]
    view = -renderer.interpolate_at(fragments, posed.faces, _camera_points(posed.verts, camera), pixels)
    rotation = camera.camera_from_world[:, :3, :3]
    return shade(albedo, _rotate(rotation, normal, row), _rotate(rotation, flat, row), view, light, row)


def _camera_points(verts: Float[Tensor, "row vert 3"], camera: Camera) -> Float[Tensor, "row vert 3"]:
    matrix = camera.camera_from_world
    return verts @ matrix[:, :3, :3].transpose(1, 2) + matrix[:, None, :3, 3]


def _rotate(
    rotation: Float[Tensor, "row 3 3"], vectors: Float[Tensor, "pixel 3"], row: Int[Tensor, " pixel"]
) -> Float[Tensor, "pixel 3"]:
    """Rotate each pixel's vector by its row's matrix."""
    return torch.einsum("pij,pj->pi", rotation.index_select(0, row), vectors)


def _scatter(
    flat: Float[Tensor, "pixel chan"], pixels: Int[Tensor, " pixel"], rows: int, size: tuple[int, int]
) -> Float[Tensor, "row chan height width"]:
    """Compact pixel values back into images over zero."""
    image = flat.new_zeros(rows * size[0] * size[1], flat.shape[1]).index_copy(0, pixels, flat)
    return image.reshape(rows, *size, -1).permute(0, 3, 1, 2).contiguous()
