"""Autograd functions around the numba kernels. CPU tensors only; first-order gradients only."""

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from fauna.kernels import antialias, barycentrics, contour, interpolation, raster, silhouette
from fauna.renderer.edges import DEPTH_TOLERANCE

Arrays = tuple[np.ndarray, ...]


def as_numpy(tensor: Tensor) -> np.ndarray:
    """Contiguous numpy view (or copy) without gradient history."""
    return tensor.detach().contiguous().numpy()


class Rasterize(torch.autograd.Function):
    """(clip_verts, faces, height, width, bands) -> (face_index, depth, barycentrics)."""

    @staticmethod
    def forward(ctx, clip_verts, faces, height, width, bands):  # noqa: D102
        clip = as_numpy(clip_verts)
        screen = raster.project(clip, height, width, bands)
        arrays = raster.rasterize(clip, screen, as_numpy(faces), height, width, bands)
        face_index, depth, weights = map(torch.from_numpy, arrays)
        ctx.save_for_backward(clip_verts, faces, face_index)
        ctx.mark_non_differentiable(face_index, depth)
        return face_index, depth, weights

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        arrays = map(as_numpy, (*ctx.saved_tensors, grads[2]))
        return torch.from_numpy(barycentrics.backward(*arrays)), None, None, None, None


class Interpolate(torch.autograd.Function):
    """(attributes, barycentrics, faces, face_index) -> (row, chan, height, width) image."""

    @staticmethod
    def forward(ctx, attributes, barycentrics, faces, face_index):  # noqa: D102
        ctx.save_for_backward(attributes, barycentrics, faces, face_index)
        rows, height, width = face_index.shape
        image = interpolation.interpolate(*_by_pixel(attributes, barycentrics, faces, face_index))
        return torch.from_numpy(image).view(rows, attributes.shape[2], height, width)

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        attributes, barycentrics, _, _ = ctx.saved_tensors
        grad = grads[0].flatten(2).numpy()  # channels cut from a longer image are read in place
        grad_attributes, grad_bary = interpolation.interpolate_backward(*_by_pixel(*ctx.saved_tensors), grad)
        return _sum_shared(grad_attributes, attributes), torch.from_numpy(grad_bary).view_as(barycentrics), None, None


class InterpolateAt(torch.autograd.Function):
    """(attributes, barycentrics, faces, face_index, pixels) -> (pixel, chan) values."""

    @staticmethod
    def forward(ctx, attributes, barycentrics, faces, face_index, pixels):  # noqa: D102
        ctx.save_for_backward(attributes, barycentrics, faces, face_index, pixels)
        arrays = _by_pixel(attributes, barycentrics, faces, face_index)
        return torch.from_numpy(interpolation.interpolate_at(*arrays, as_numpy(pixels)))

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        attributes, barycentrics, faces, face_index, pixels = ctx.saved_tensors
        arrays = (*_by_pixel(attributes, barycentrics, faces, face_index), as_numpy(pixels), as_numpy(grads[0]))
        grad_attributes, grad_bary = interpolation.interpolate_at_backward(*arrays)
        grad_bary = torch.from_numpy(grad_bary).view_as(barycentrics)
        return _sum_shared(grad_attributes, attributes), grad_bary, None, None, None


class Antialias(torch.autograd.Function):
    """(image, clip_verts, faces, edges, edge_faces, face_index, depth) -> image blended across contours."""

    @staticmethod
    def forward(ctx, image, clip_verts, faces, edges, edge_faces, face_index, depth):  # noqa: D102
        mesh = tuple(map(as_numpy, (clip_verts, faces, edges, edge_faces)))
        crossings = silhouette.find_crossings(*mesh, as_numpy(face_index), as_numpy(depth), True, DEPTH_TOLERANCE)
        starts, cell, _, place = crossings
        blended = antialias.blend(as_numpy(image.flatten(2)), *image.shape[2:], starts, cell, place)
        ctx.save_for_backward(image, clip_verts, edges)
        ctx.crossings = crossings
        return torch.from_numpy(blended).view(image.shape)

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        image, clip_verts, edges = ctx.saved_tensors
        arrays = tuple(map(as_numpy, (image.flatten(2), clip_verts, edges)))
        grad = as_numpy(grads[0].flatten(2))
        grad_image, grad_clip = antialias.blend_backward(*arrays, *image.shape[2:], *ctx.crossings, grad)
        return torch.from_numpy(grad_image).view(image.shape), torch.from_numpy(grad_clip), *[None] * 5


class Transfers(torch.autograd.Function):
    """(clip_verts, faces, edges, edge_faces, face_index, depth) -> (target, source, share) of ``renderer.contour``."""

    @staticmethod
    def forward(ctx, clip_verts, faces, edges, edge_faces, face_index, depth):  # noqa: D102
        mesh = tuple(map(as_numpy, (clip_verts, faces, edges, edge_faces)))
        crossings = silhouette.find_crossings(*mesh, as_numpy(face_index), as_numpy(depth), True, DEPTH_TOLERANCE)
        starts, cell, _, place = crossings
        size = tuple(face_index.shape[1:])
        target, source, share = map(torch.from_numpy, contour.transfers(*size, starts, cell, place))
        ctx.save_for_backward(clip_verts, edges)
        ctx.crossings = (size, crossings)
        ctx.mark_non_differentiable(target, source)
        return target, source, share

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        clip_verts, edges = map(as_numpy, ctx.saved_tensors)
        size, crossings = ctx.crossings
        grad_clip = contour.transfers_backward(clip_verts, edges, *size, *crossings, as_numpy(grads[2]))
        return torch.from_numpy(grad_clip), *[None] * 5


class Silhouette(torch.autograd.Function):
    """(clip_verts, faces, edges, edge_faces, height, width, bands) -> antialiased coverage in [0, 1]."""

    @staticmethod
    def forward(ctx, clip_verts, faces, edges, edge_faces, height, width, bands):  # noqa: D102
        mesh = tuple(map(as_numpy, (clip_verts, faces, edges, edge_faces)))
        covered = raster.cover(raster.project(mesh[0], height, width, bands), mesh[1], height, width, bands)
        no_depth = np.empty((1, 1, 1), mesh[0].dtype)
        crossings = silhouette.find_crossings(*mesh, covered, no_depth, False, DEPTH_TOLERANCE)
        starts, cell, _, place = crossings
        raw, clamped = antialias.coverage(covered, no_depth, starts, cell, place)
        ctx.save_for_backward(clip_verts, edges)
        ctx.coverage = (raw, height, width, crossings)
        return torch.from_numpy(clamped).view(-1, height, width)

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        clip_verts, edges = map(as_numpy, ctx.saved_tensors)
        raw, height, width, crossings = ctx.coverage
        grad = as_numpy(grads[0].flatten(1))
        grad_clip = antialias.coverage_backward(raw, clip_verts, edges, height, width, *crossings, grad)
        return torch.from_numpy(grad_clip), *[None] * 6


def _by_pixel(attributes: Tensor, barycentrics: Tensor, faces: Tensor, face_index: Tensor) -> Arrays:
    """Kernel arguments with the two image axes flattened."""
    return tuple(map(as_numpy, (attributes, faces, face_index.flatten(1), barycentrics.flatten(1, 2))))


def _sum_shared(per_row: np.ndarray, attributes: Tensor) -> Tensor:
    """Gradient of attributes from that of every row: summed if one set served all rows."""
    grad = torch.from_numpy(per_row)
    return grad if attributes.shape[0] == per_row.shape[0] else grad.sum(dim=0, keepdim=True)
