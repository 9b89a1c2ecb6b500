"""Random views for the mask discriminator (supplement, "Mask Discriminator Details")."""

import math
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from fauna.geometry.rotations import rotation_y

RandomView = Literal["upright", "predicted"]


@torch.no_grad()
def random_view_rotations(
    predicted: Float[Tensor, "row 3 3"], mode: RandomView, generator: torch.Generator
) -> Float[Tensor, "row 3 3"]:
    """camera_from_world rotations after a uniformly random turn about the animal's vertical axis.

    ``predicted`` turns the animal inside the predicted viewpoint (the paper's text), so its elevation stays;
    ``upright`` drops the predicted rotation and looks horizontally (the published code). No gradient reaches the viewpoint.
    """
    angles = torch.rand(predicted.shape[0], generator=generator, dtype=torch.float64) * 2 * math.pi
    turn = rotation_y(angles.to(predicted))  # (row, 3, 3)
    return turn if mode == "upright" else predicted.detach() @ turn
