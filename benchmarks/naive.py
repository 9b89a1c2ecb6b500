"""The training step as a direct transcription of the method has it, for ``benchmarks/step.py`` to compare with.

Same model, same batches, same losses; but the signed distance is evaluated with gradient at every lattice point, albedo and
features are evaluated at every pixel of every image, conditions are concatenated to every point, whole images are
antialiased and compared, and rasterisation is in plain torch.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import fields
from unittest.mock import patch

import torch
from torch import Tensor

import fauna.model
from fauna.appearance.shading import shade
from fauna.geometry.camera import to_clip
from fauna.geometry.lattice import BCCLattice, ExplicitLattice, explicit_lattice
from fauna.geometry.marching_tets import drop_small_components
from fauna.geometry.mesh import face_normals, vertex_normals
from fauna.geometry.sparse_extraction import ExtractionStats, extract_dense
from fauna.networks import CoordMLP
from fauna.renderer.torch_backend import TorchRenderer
from fauna.shape.sdf_mesh import SDFMesh
from fauna.system import FaunaSystem
from fauna.types import BaseShape, Renders, Shading

LATTICES: dict[BCCLattice, ExplicitLattice] = {}
"""Tetrahedra by lattice; listing them is not part of a step."""


@contextmanager
def naive_structure(system: FaunaSystem) -> Iterator[None]:
    """Within this context steps of ``system`` are done the direct way."""
    model = system.model
    own = model.renderer

    def extract(shape: SDFMesh, embedding: Tensor, generator: torch.Generator | None):
        if shape.lattice not in LATTICES:
            LATTICES[shape.lattice] = explicit_lattice(shape.lattice)
        field, offset = shape.sdf(embedding), shape._offset(generator)
        verts, faces = extract_dense(field, shape.lattice, offset, explicit=LATTICES[shape.lattice])[:2]
        verts, faces = drop_small_components(verts, faces, shape.min_component_fraction)
        return BaseShape(verts, faces), ExtractionStats(*[0] * len(fields(ExtractionStats)))

    with ExitStack() as patches:
        patches.enter_context(patch.object(SDFMesh, "extract", extract))
        patches.enter_context(patch.object(CoordMLP, "forward", concatenated))
        patches.enter_context(patch.object(CoordMLP, "grid", repeated))
        patches.enter_context(patch.object(fauna.model, "render", render_all))
        model.renderer = TorchRenderer()
        try:
            yield
        finally:
            model.renderer = own


def concatenated(field: CoordMLP, points: Tensor, condition: Tensor | None = None, group: Tensor | None = None):
    """The field with its condition attached to every point."""
    hidden = field.in_layer(field.embedding(points))
    if condition is not None:
        rows = condition.expand(len(points), -1) if group is None else condition[group]
        hidden = torch.cat((hidden, rows), dim=1)
    return field.mlp(hidden.relu())


def repeated(field: CoordMLP, points: Tensor, condition: Tensor) -> Tensor:
    """The field of every condition, with the points repeated."""
    group = torch.arange(len(condition), device=points.device).repeat_interleave(len(points))
    return field(points.repeat(len(condition), 1), condition, group).reshape(len(condition), len(points), -1)


def render_all(renderer, posed, topology, camera, size, *, appearance, texture, code, light, **_) -> Renders:
    """Every field at every pixel of every image, background included."""
    clip = to_clip(posed.verts, camera.clip_from_world)
    fragments = renderer.rasterize(clip, posed.faces, *size)
    pixels = torch.arange(fragments.face_index.numel(), device=clip.device)
    row = pixels // (size[0] * size[1])
    rotation = camera.camera_from_world[:, :3, :3]
    view = posed.verts @ rotation.transpose(1, 2) + camera.camera_from_world[:, None, :3, 3]

    def image(attributes: Tensor) -> Tensor:
        return renderer.interpolate(fragments, posed.faces, attributes).movedim(1, -1).reshape(len(pixels), -1)

    points = image(posed.canonical[None])
    normal = image(vertex_normals(posed.verts, posed.faces))
    flat = face_normals(posed.verts, posed.faces)[row, fragments.face_index.reshape(-1)]
    normal, flat = (torch.einsum("pij,pj->pi", rotation[row], vectors) for vectors in (normal, flat))
    albedo = appearance.albedo(points, texture, row)
    rgb = shade(albedo, normal, flat, -image(view), light, row)
    values = torch.cat((rgb, appearance.features(points, code)), dim=1) * fragments.covered.reshape(-1, 1)
    stacked = torch.cat((values, fragments.covered.reshape(-1, 1).to(values)), dim=1)
    images = stacked.reshape(len(clip), *size, -1).movedim(-1, 1).contiguous()
    images = renderer.antialias(images, fragments, clip, posed.faces, topology)
    values = images.movedim(1, -1).reshape(len(pixels), -1)
    shading = Shading(pixels, row, values[:, :3], values[:, 3:-1], 1.0)
    return Renders(silhouette=images[:, -1].clamp(0, 1), covered=fragments.covered, shading=shading)
