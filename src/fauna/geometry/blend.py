"""Blending of bone matrices over vertices, with a backward pass of its own.

Neither pass keeps a matrix per vertex: both go over the vertices in blocks that stay in a processor's cache and blend
the matrices of a block anew. Only the inputs are kept for the backward pass.
"""

from collections.abc import Iterator
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

_CPU_BLOCK = 1 << 18
"""Numbers of one block of blended matrices on a CPU (1 MB in float32) ..."""

_CPU_VERTS = 2048
"""... unless these are fewer vertices than this: below, calls cost more than cache misses."""


def vertex_blocks(verts: int, numbers_per_vertex: int, device: torch.device) -> Iterator[slice]:
    """Slices of the vertex axis whose intermediate results fit a cache; a GPU takes all at once."""
    size = max(_CPU_BLOCK // numbers_per_vertex, _CPU_VERTS) if device.type == "cpu" else max(verts, 1)
    for start in range(0, verts, size):
        yield slice(start, min(start + size, verts))


class BlendedMotion(torch.autograd.Function):
    """``v'_prv = (sum_b w_pbv T_prb) v_pv`` for the rows r of photos p; differentiable once, to vertices and matrices."""

    @staticmethod
    def forward(
        ctx: Any,
        verts: Float[Tensor, "#photo vert 3"],
        columns: Float[Tensor, "photo row 12 bone"],
        weights: Float[Tensor, "#photo bone vert"],
    ) -> Float[Tensor, "photo row vert 3"]:
        """Move the vertices of every row.

        Args:
            ctx: of autograd.
            verts: rest positions.
            columns: the columns of each bone's 3 x 4 matrix below each other.
            weights: of each bone for each vertex, constant.
        """
        photos, rows, count = *columns.shape[:2], verts.shape[1]
        moved = verts.new_empty(photos, rows, count, 3)
        for block in vertex_blocks(count, 12 * photos * rows, verts.device):
            matrix = _blended(columns, weights[..., block])
            x, y, z = _coordinates(verts, block)
            out = torch.addcmul(matrix[:, :, 3], matrix[:, :, 0], x)
            out.addcmul_(matrix[:, :, 1], y).addcmul_(matrix[:, :, 2], z)
            moved[:, :, block] = out.transpose(2, 3)
        ctx.save_for_backward(verts, columns, weights)
        return moved

    @staticmethod
    @once_differentiable
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any, *grad_outputs: Tensor
    ) -> tuple[Tensor, Tensor, None]:
        """Gradients of vertices and matrices."""
        (grad,), (verts, columns, weights) = grad_outputs, ctx.saved_tensors
        to_verts, to_columns = torch.empty_like(verts), torch.zeros_like(columns)
        for block in vertex_blocks(verts.shape[1], 12 * columns.shape[0] * columns.shape[1], verts.device):
            matrix = _blended(columns, weights[..., block])
            out = grad[:, :, block].transpose(2, 3).contiguous()  # (photo, row, coordinate, vert)
            to_rows = matrix[:, :, :3, 0] * out[:, :, 0:1]  # (photo, row, column, vert)
            for coordinate in (1, 2):  # a sum over two axes at once is many times slower
                to_rows.addcmul_(matrix[:, :, :3, coordinate], out[:, :, coordinate : coordinate + 1])
            to_photos = to_rows.sum(1)
            shared = verts.shape[0] == 1
            to_verts[:, block] = (to_photos.sum(0, keepdim=True) if shared else to_photos).transpose(1, 2)
            for column, coordinate in enumerate(_coordinates(verts, block)):
                torch.mul(out, coordinate, out=matrix[:, :, column])
            matrix[:, :, 3] = out
            flat = matrix.flatten(1, 3)
            to_columns += (flat @ weights[..., block].transpose(1, 2)).reshape(columns.shape)
        return to_verts, to_columns, None


def _coordinates(verts: Float[Tensor, "item vert 3"], block: slice) -> tuple[Tensor, ...]:
    """x, y and z of a block's vertices, each (item, 1, 1, vert)."""
    return verts[:, block].transpose(1, 2).contiguous()[:, :, None, None].unbind(1)


def _blended(
    columns: Float[Tensor, "photo row 12 bone"], weights: Float[Tensor, "#photo bone vert"]
) -> Float[Tensor, "photo row 4 3 vert"]:
    """Each vertex' matrix (column, coordinate)."""
    return (columns.flatten(1, 2) @ weights).unflatten(1, (columns.shape[1], 4, 3))
