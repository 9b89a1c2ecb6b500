"""Viewpoint hypotheses, one per quadrant (supplement, "Viewpoint Learning Details")."""

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from fauna.encoder.embedder import ConvTrunk, TrunkOptions
from fauna.geometry.rotations import look_at_rotation
from fauna.types import Features, Hypotheses

QUADRANTS = ((1.0, 1.0, 1.0), (-1.0, 1.0, 1.0), (-1.0, 1.0, -1.0), (1.0, 1.0, -1.0))
"""Signs of the animal's forward axis in camera coordinates, one row per hypothesis."""

_SHARPNESS = math.log(2.0) / 0.5
"""Of the softplus that makes x and z positive: its value at 0 is 0.5."""


class ViewpointNetwork(nn.Module):
    """Feature map -> four viewpoints of a photo, with the loss each is expected to have, and a translation.

    A hypothesis is the direction of the animal's +z axis in the camera's frame, without roll. Its x and z keep the
    signs of the hypothesis' quadrant.

    Args:
        key_dim: channels of the key map.
        trunk: shape of the convolutional trunk.
        max_translation_xy: bound of the translation parallel to the image, world units.
        max_translation_z: bound of the translation along the optical axis, world units.

    Attributes:
        turned: learned with the head at -z, see :mod:`fauna.geometry.half_turn`; each hypothesis then looks the other way.
    """

    turned: bool = False

    def __init__(
        self, *, key_dim: int, trunk: TrunkOptions, max_translation_xy: float, max_translation_z: float
    ) -> None:
        super().__init__()
        self.trunk = ConvTrunk(in_dim=key_dim, out_dim=4 * len(QUADRANTS) + 3, options=trunk)
        bound = torch.tensor([max_translation_xy, max_translation_xy, max_translation_z])
        self.bound: Tensor
        self.quadrants: Tensor
        self.register_buffer("bound", bound, persistent=False)
        self.register_buffer("quadrants", torch.tensor(QUADRANTS), persistent=False)

    def forward(self, features: Features, *, temperature: float, elevation: bool) -> Hypotheses:
        """Predict all hypotheses.

        Args:
            features: of the photos.
            temperature: tau of ``p_k ~ exp(-sigma_k / tau)``.
            elevation: let the forward axis leave the camera's horizontal plane.
        """
        raw = self.trunk(features.keys)
        sign = -1.0 if self.turned else 1.0
        scores, directions = raw[:, :-3].unflatten(1, (len(QUADRANTS), 4)).split((1, 3), dim=-1)
        predicted = scores[..., 0]
        return Hypotheses(
            rotations=look_at_rotation(sign * self._forward_axes(directions, elevation)),
            translation=raw[:, -3:].tanh() * self.bound,
            predicted_losses=predicted,
            probabilities=torch.softmax(-predicted / temperature, dim=1),
        )

    def _forward_axes(self, raw: Float[Tensor, "batch hyp 3"], elevation: bool) -> Float[Tensor, "batch hyp 3"]:
        x, y, z = raw.unbind(-1)
        x, z = F.softplus(x, beta=_SHARPNESS), F.softplus(z, beta=_SHARPNESS)
        y = y if elevation else torch.zeros_like(y)
        return torch.stack((x, y, z), dim=-1) * self.quadrants
