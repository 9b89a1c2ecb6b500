"""What stands out in a photograph, cell by cell of a frozen encoder's feature grid. No weights of its own, no labels."""

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from fauna.data.photos import resize_image
from fauna.encoder.base import Encoder
from fauna.masks.options import SaliencyOptions


@torch.no_grad()
def saliency(
    encoder: Encoder, image: UInt8[np.ndarray, "height width 3"], options: SaliencyOptions
) -> Float[np.ndarray, "grid_height grid_width"]:
    """Rate the cells of a picture; mean 0 and deviation 1.

    A cell stands out when its token is far from the mean token of the cells along the border, and when it is near the centre.
    From the cells that stand out most and least a direction in feature space is taken, and all cells are rated along it.

    Args:
        encoder: frozen.
        image: of any size; it is brought to the encoder's square.
        options: weights and shares.
    """
    return rate(encoder(resize_image(image, encoder.input_size)[None].to(encoder.device)).tokens[0].cpu(), options)


def rate(
    tokens: Float[Tensor, "chan grid_height grid_width"], options: SaliencyOptions
) -> Float[np.ndarray, "grid_height grid_width"]:
    """:func:`saliency` of a feature map, whose channels are standardised first."""
    grid = (tokens.shape[1], tokens.shape[2])
    flat = tokens.flatten(1).double().numpy()
    flat = (flat - flat.mean(axis=1, keepdims=True)) / (flat.std(axis=1, keepdims=True) + 1e-6)
    border = np.ones(grid, bool)
    border[1:-1, 1:-1] = False
    distance = np.linalg.norm(flat - flat[:, border.ravel()].mean(axis=1, keepdims=True), axis=0)
    first = _standard(
        _standard(distance) + options.centre_weight * _standard(_centre(grid, options.centre_sigma).ravel())
    )
    front = first >= np.quantile(first, 1.0 - options.foreground_share)
    back = first <= np.quantile(first, options.background_share)
    direction = flat[:, front].mean(axis=1) - flat[:, back].mean(axis=1)
    return _standard(_standard(direction @ flat) + options.first_weight * first).reshape(grid)


def _centre(grid: tuple[int, int], sigma: float) -> Float[np.ndarray, "grid_height grid_width"]:
    """Logarithm of a Gaussian around the centre of the picture."""
    rows, columns = ((np.arange(count) + 0.5) / count - 0.5 for count in grid)
    return -0.5 * (rows[:, None] ** 2 + columns[None, :] ** 2) / sigma**2


def _standard(values: Float[np.ndarray, " cell"]) -> Float[np.ndarray, " cell"]:
    return (values - values.mean()) / (values.std() + 1e-9)
