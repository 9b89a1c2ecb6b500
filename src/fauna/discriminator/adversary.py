"""The adversarial game around the mask discriminator (Sec. 3.2, "Mask Discriminator")."""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fauna.errors import FaunaError
from fauna.geometry.camera import make_camera
from fauna.losses.adversarial import adversarial_loss, discriminator_loss, gradient_penalty
from fauna.random import Draws
from fauna.renderer.base import Renderer
from fauna.renderer.deferred import render_silhouette
from fauna.types import Batch, Reconstruction
from fauna.viewpoint.random_view import RandomView, random_view_rotations


@dataclass(frozen=True)
class MaskPair:
    """What the discriminator learns from; all detached.

    Attributes:
        real: (batch, height, width).
        fake: (batch, height, width) silhouettes from random views.
        condition: (value_chan,) shape code.
    """

    real: Float[Tensor, "batch height width"]
    fake: Float[Tensor, "batch height width"]
    condition: Float[Tensor, " value_chan"]


class Adversary(nn.Module):
    """A mask discriminator and the rules of its game.

    Args:
        network: masks and condition -> logits; ``None`` switches the game off whatever the schedule says.
        random_view: ``predicted`` turns the predicted viewpoint about the vertical (paper), ``upright`` ignores it.
        real_masks: ``observed`` masks (paper) or the ``rendered`` input-view silhouettes (published code).
        penalty: weight of the gradient penalty at real masks inside the discriminator's loss (halved with it).
    """

    def __init__(
        self,
        *,
        network: nn.Module | None,
        random_view: RandomView,
        real_masks: Literal["observed", "rendered"],
        penalty: float,
    ) -> None:
        super().__init__()
        if random_view not in ("predicted", "upright"):
            raise FaunaError(f"discriminator.random_view must be predicted or upright, got {random_view!r}; choose one")
        if real_masks not in ("observed", "rendered"):
            raise FaunaError(f"discriminator.real_masks must be observed or rendered, got {real_masks!r}; choose one")
        self.network = network
        self.random_view: RandomView = random_view
        self.real_masks = real_masks
        self.penalty = penalty

    def generator_loss(
        self, batch: Batch, out: Reconstruction, renderer: Renderer, camera: dict[str, float], draws: Draws
    ) -> tuple[Float[Tensor, ""], MaskPair]:
        """Loss of the shapes against the discriminator, and the detached masks for its own step.

        Gradient reaches shape, deformation, articulation and bank, but neither the viewpoint nor the discriminator.
        """
        assert self.network is not None, "the schedule asked a switched-off adversary"
        row = _one_row_per_photo(out)
        fake = self._random_silhouettes(out, row, renderer, camera, draws.generator("random_view"))
        condition = out.code.detach()
        for parameter in self.network.parameters():
            parameter.requires_grad_(False)
        loss = adversarial_loss(self.network(fake, condition))
        for parameter in self.network.parameters():
            parameter.requires_grad_(True)
        real = batch.masks if self.real_masks == "observed" else out.renders.silhouette[row]
        return loss, MaskPair(real.detach(), fake.detach(), condition)

    def discriminator_loss(self, pair: MaskPair) -> dict[str, Float[Tensor, ""]]:
        """Terms of the discriminator's own loss: ``discriminator`` (with its penalty) and ``gradient_penalty``."""
        assert self.network is not None
        real = pair.real.clone().requires_grad_(True)
        logits = self.network(real, pair.condition)
        penalty = gradient_penalty(logits, real)
        loss = discriminator_loss(logits, self.network(pair.fake, pair.condition))
        return {"discriminator": loss + 0.5 * self.penalty * penalty, "gradient_penalty": penalty.detach()}

    def _random_silhouettes(
        self,
        out: Reconstruction,
        row: Tensor,
        renderer: Renderer,
        options: dict[str, float],
        generator: torch.Generator,
    ) -> Float[Tensor, "batch height width"]:
        rotations = out.camera.camera_from_world[row, :3, :3].detach()
        views = random_view_rotations(rotations, self.random_view, generator)
        translation = out.hypotheses.translation.detach()[out.selection.photo[row]]
        camera = make_camera(views, translation, fov_deg=options["fov_deg"], distance=options["distance"])
        height, width = out.renders.silhouette.shape[-2:]
        return render_silhouette(renderer, out.posed.rows(row), camera, (height, width), topology=out.base.topology)


def _one_row_per_photo(out: Reconstruction) -> Tensor:
    """The most probable rendered row of each photo."""
    probability = out.hypotheses.probabilities[out.selection.photo, out.selection.hypothesis]
    return probability.reshape(out.hypotheses.probabilities.shape[0], -1).argmax(dim=1) + torch.arange(
        out.hypotheses.probabilities.shape[0], device=probability.device
    ) * (probability.shape[0] // out.hypotheses.probabilities.shape[0])
