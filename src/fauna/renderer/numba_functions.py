"""Autograd functions around the numba kernels. CPU tensors only; first-order gradients only."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from fauna.kernels import antialias, barycentrics, contour, interpolation, raster, silhouette
from fauna.renderer.edges import DEPTH_TOLERANCE


def call(kernel: Callable[..., Any], *arguments: Any) -> Any:
    """Result of a kernel; it gets contiguous views (or copies) of the tensors among its arguments."""
    return kernel(*(x.detach().contiguous().numpy() if isinstance(x, Tensor) else x for x in arguments))


class Rasterize(torch.autograd.Function):
    """(clip_verts, faces, height, width, bands) -> (face_index, depth, barycentrics)."""

    @staticmethod
    def forward(ctx, clip_verts, faces, height, width, bands):  # noqa: D102
        screen = call(raster.project, clip_verts, height, width, bands)
        arrays = call(raster.rasterize, clip_verts, screen, faces, height, width, bands)
        face_index, depth, weights = map(torch.from_numpy, arrays)
        ctx.save_for_backward(clip_verts, faces, face_index)
        ctx.mark_non_differentiable(face_index, depth)
        return face_index, depth, weights

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        grad_clip = call(barycentrics.backward, *ctx.saved_tensors, grads[2])
        return torch.from_numpy(grad_clip), None, None, None, None


class Interpolate(torch.autograd.Function):
    """(attributes, barycentrics, faces, face_index) -> (row, chan, height, width) image."""

    @staticmethod
    def forward(ctx, attributes, barycentrics, faces, face_index):  # noqa: D102
        ctx.save_for_backward(attributes, barycentrics, faces, face_index)
        rows, height, width = face_index.shape
        image = call(interpolation.interpolate, *_by_pixel(attributes, barycentrics, faces, face_index))
        return torch.from_numpy(image).view(rows, attributes.shape[2], height, width)

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        attributes, barycentrics, _, _ = ctx.saved_tensors
        grad = grads[0].flatten(2).numpy()  # channels cut from a longer image are read in place
        grad_attributes, grad_bary = call(interpolation.interpolate_backward, *_by_pixel(*ctx.saved_tensors), grad)
        return _sum_shared(grad_attributes, attributes), torch.from_numpy(grad_bary).view_as(barycentrics), None, None


class InterpolateAt(torch.autograd.Function):
    """(attributes, barycentrics, faces, face_index, pixels) -> (pixel, chan) values."""

    @staticmethod
    def forward(ctx, attributes, barycentrics, faces, face_index, pixels):  # noqa: D102
        ctx.save_for_backward(attributes, barycentrics, faces, face_index, pixels)
        inputs = _by_pixel(attributes, barycentrics, faces, face_index)
        return torch.from_numpy(call(interpolation.interpolate_at, *inputs, pixels))

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        attributes, barycentrics, faces, face_index, pixels = ctx.saved_tensors
        inputs = _by_pixel(attributes, barycentrics, faces, face_index)
        grad_attributes, grad_bary = call(interpolation.interpolate_at_backward, *inputs, pixels, grads[0])
        grad_bary = torch.from_numpy(grad_bary).view_as(barycentrics)
        return _sum_shared(grad_attributes, attributes), grad_bary, None, None, None


class Antialias(torch.autograd.Function):
    """(image, clip_verts, faces, edges, edge_faces, face_index, depth) -> image blended across contours."""

    @staticmethod
    def forward(ctx, image, clip_verts, faces, edges, edge_faces, face_index, depth):  # noqa: D102
        mesh = (clip_verts, faces, edges, edge_faces)
        crossings = call(silhouette.find_crossings, *mesh, face_index, depth, True, DEPTH_TOLERANCE)
        starts, cell, _, place = crossings
        blended = call(antialias.blend, image.flatten(2), *image.shape[2:], starts, cell, place)
        ctx.save_for_backward(image, clip_verts, edges)
        ctx.crossings = crossings
        return torch.from_numpy(blended).view(image.shape)

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        image, clip_verts, edges = ctx.saved_tensors
        inputs = (image.flatten(2), clip_verts, edges, *image.shape[2:], *ctx.crossings, grads[0].flatten(2))
        grad_image, grad_clip = call(antialias.blend_backward, *inputs)
        return torch.from_numpy(grad_image).view(image.shape), torch.from_numpy(grad_clip), *[None] * 5


class Transfers(torch.autograd.Function):
    """(clip_verts, faces, edges, edge_faces, face_index, depth) -> (target, source, share) of ``renderer.contour``."""

    @staticmethod
    def forward(ctx, clip_verts, faces, edges, edge_faces, face_index, depth):  # noqa: D102
        mesh, size = (clip_verts, faces, edges, edge_faces), tuple(face_index.shape[1:])
        crossings = call(silhouette.find_crossings, *mesh, face_index, depth, True, DEPTH_TOLERANCE)
        starts, cell, _, place = crossings
        target, source, share = map(torch.from_numpy, call(contour.transfers, *size, starts, cell, place))
        ctx.save_for_backward(clip_verts, edges)
        ctx.crossings = (size, crossings)
        ctx.mark_non_differentiable(target, source)
        return target, source, share

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        size, crossings = ctx.crossings
        grad_clip = call(contour.transfers_backward, *ctx.saved_tensors, *size, *crossings, grads[2])
        return torch.from_numpy(grad_clip), *[None] * 5


class Silhouette(torch.autograd.Function):
    """(clip_verts, faces, edges, edge_faces, height, width, bands) -> antialiased coverage in [0, 1]."""

    @staticmethod
    def forward(ctx, clip_verts, faces, edges, edge_faces, height, width, bands):  # noqa: D102
        mesh, no_depth = (clip_verts, faces, edges, edge_faces), clip_verts.new_empty(1, 1, 1)
        screen = call(raster.project, clip_verts, height, width, bands)
        covered = call(raster.cover, screen, faces, height, width, bands)
        crossings = call(silhouette.find_crossings, *mesh, covered, no_depth, False, DEPTH_TOLERANCE)
        starts, cell, _, place = crossings
        raw, clamped = call(antialias.coverage, covered, no_depth, starts, cell, place)
        ctx.save_for_backward(clip_verts, edges)
        ctx.coverage = (raw, height, width, crossings)
        return torch.from_numpy(clamped).view(-1, height, width)

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        clip_verts, edges = ctx.saved_tensors
        raw, height, width, crossings = ctx.coverage
        inputs = (raw, clip_verts, edges, height, width, *crossings, grads[0].flatten(1))
        grad_clip = call(antialias.coverage_backward, *inputs)
        return torch.from_numpy(grad_clip), *[None] * 6


def _by_pixel(attributes: Tensor, barycentrics: Tensor, faces: Tensor, face_index: Tensor) -> tuple[Tensor, ...]:
    """Kernel arguments with the two image axes flattened."""
    return attributes, faces, face_index.flatten(1), barycentrics.flatten(1, 2)


def _sum_shared(per_row: np.ndarray, attributes: Tensor) -> Tensor:
    """Gradient of attributes from that of every row: summed if one set served all rows."""
    grad = torch.from_numpy(per_row)
    return grad if attributes.shape[0] == per_row.shape[0] else grad.sum(dim=0, keepdim=True)
