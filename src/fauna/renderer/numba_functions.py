"""Autograd functions around the numba kernels. CPU tensors only; first-order gradients only."""

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from fauna.kernels import interpolation as kernels
from fauna.kernels import silhouette as edge_kernels

Arrays = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def as_numpy(tensor: Tensor) -> np.ndarray:
    """Contiguous numpy view (or copy) without gradient history."""
    return tensor.detach().contiguous().numpy()


class Barycentrics(torch.autograd.Function):
    """(clip_verts, faces, face_index) -> barycentrics."""

    @staticmethod
    def forward(ctx, clip_verts, faces, face_index):  # noqa: D102
        ctx.save_for_backward(clip_verts, faces, face_index)
        return torch.from_numpy(kernels.barycentrics(as_numpy(clip_verts), as_numpy(faces), as_numpy(face_index)))

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        (grad,) = grads
        clip_verts, faces, face_index = map(as_numpy, ctx.saved_tensors)
        return (
            torch.from_numpy(kernels.barycentrics_backward(clip_verts, faces, face_index, as_numpy(grad))),
            None,
            None,
        )


class Interpolate(torch.autograd.Function):
    """(attributes, barycentrics, faces, face_index) -> (row, chan, height, width) image."""

    @staticmethod
    def forward(ctx, attributes, barycentrics, faces, face_index):  # noqa: D102
        ctx.save_for_backward(attributes, barycentrics, faces, face_index)
        rows, height, width = face_index.shape
        arrays = _by_pixel(attributes, barycentrics, faces, face_index)
        return torch.from_numpy(kernels.interpolate(*arrays)).view(rows, -1, height, width)

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        (grad,) = grads
        attributes, barycentrics, _, _ = ctx.saved_tensors
        grad_attributes, grad_bary = kernels.interpolate_backward(
            *_by_pixel(*ctx.saved_tensors), as_numpy(grad.flatten(2))
        )
        return _sum_shared(grad_attributes, attributes), torch.from_numpy(grad_bary).view_as(barycentrics), None, None


class InterpolateAt(torch.autograd.Function):
    """(attributes, barycentrics, faces, face_index, pixels) -> (pixel, chan) values."""

    @staticmethod
    def forward(ctx, attributes, barycentrics, faces, face_index, pixels):  # noqa: D102
        ctx.save_for_backward(attributes, barycentrics, faces, face_index, pixels)
        arrays = _by_pixel(attributes, barycentrics, faces, face_index)
        return torch.from_numpy(kernels.interpolate_at(*arrays, as_numpy(pixels)))

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        (grad,) = grads
        attributes, barycentrics, faces, face_index, pixels = ctx.saved_tensors
        arrays = _by_pixel(attributes, barycentrics, faces, face_index)
        grad_attributes, grad_bary = kernels.interpolate_at_backward(*arrays, as_numpy(pixels), as_numpy(grad))
        grad_bary = torch.from_numpy(grad_bary).view_as(barycentrics)
        return _sum_shared(grad_attributes, attributes), grad_bary, None, None, None


class Blend(torch.autograd.Function):
    """(image, weights, inner, outer) -> image blended across the contour, see ``edges.blend``."""

    @staticmethod
    def forward(ctx, image, weights, inner, outer):  # noqa: D102
        ctx.save_for_backward(image, weights, inner, outer)
        blended = image.detach().clone(memory_format=torch.contiguous_format)
        arrays = map(as_numpy, (image.flatten(2), inner, outer, weights, blended.flatten(2)))
        edge_kernels.blend(*arrays)
        return blended

    @staticmethod
    @once_differentiable
    def backward(ctx, *grads):  # noqa: D102  # pyright: ignore[reportIncompatibleMethodOverride]
        image, weights, inner, outer = ctx.saved_tensors
        grad = grads[0].contiguous()
        grad_image, grad_weights = grad.clone(), torch.empty_like(weights)
        arrays = (image.flatten(2), inner, outer, weights, grad.flatten(2), grad_image.flatten(2), grad_weights)
        edge_kernels.blend_backward(*map(as_numpy, arrays))
        return grad_image, grad_weights, None, None


def _by_pixel(attributes: Tensor, barycentrics: Tensor, faces: Tensor, face_index: Tensor) -> Arrays:
    """Kernel arguments with the two image axes flattened."""
    return (
        as_numpy(attributes),
        as_numpy(faces),
        as_numpy(face_index.flatten(1)),
        as_numpy(barycentrics.flatten(1, 2)),
    )


def _sum_shared(per_row: np.ndarray, attributes: Tensor) -> Tensor:
    """Gradient of attributes from that of every row: summed if one set served all rows."""
    grad = torch.from_numpy(per_row)
    return grad if attributes.shape[0] == per_row.shape[0] else grad.sum(dim=0, keepdim=True)
