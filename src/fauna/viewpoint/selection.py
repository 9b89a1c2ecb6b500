"""Which viewpoint hypotheses of a photo are rendered (supplement, "Viewpoint Learning Details")."""

from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fauna.errors import FaunaError
from fauna.geometry.camera import make_camera
from fauna.types import Camera, Hypotheses, Selection


def mixed_probabilities(hypotheses: Hypotheses, uniform_mix: float) -> Float[Tensor, "batch hyp"]:
    """``uniform_mix / 4 + (1 - uniform_mix) p_k``."""
    probabilities = hypotheses.probabilities
    return uniform_mix / probabilities.shape[1] + (1.0 - uniform_mix) * probabilities


def best(hypotheses: Hypotheses) -> Selection:
    """The hypothesis with the lowest predicted loss of each photo, as at test time."""
    choice = hypotheses.predicted_losses.detach().argmin(dim=1)
    return Selection(torch.arange(choice.shape[0], device=choice.device), choice)


def select(
    hypotheses: Hypotheses,
    *,
    mode: Literal["one", "all"],
    uniform_mix: float,
    best_fraction: float,
    generator: torch.Generator,
) -> Selection:
    """Choose the rows of a training step.

    ``all`` renders every hypothesis of every photo, photo-major. ``one`` renders the most probable hypothesis of a
    random ``best_fraction`` of the photos and a uniformly random one of the others, spread evenly over the hypotheses.

    Args:
        hypotheses: of the batch.
        mode: ``one`` or ``all``.
        uniform_mix: share of the uniform distribution in the probabilities; at 1 all are alike and every photo draws.
        best_fraction: expected share of photos that take their best hypothesis.
        generator: CPU generator of the draws.

    Raises:
        FaunaError: for an unknown mode.
    """
    photos, number = hypotheses.probabilities.shape
    if mode == "all":
        index = torch.arange(photos * number, device=hypotheses.probabilities.device)
        return Selection(index // number, index % number)
    if mode != "one":
        raise FaunaError(f"hypotheses must be one or all, got {mode!r}; set schedule.all_hypotheses")
    explored = _balanced_draw(photos, number, generator)
    rank = torch.randperm(photos, generator=generator) + torch.rand(1, generator=generator)
    exploit = (rank < best_fraction * photos) & (uniform_mix < 1.0)
    likely = mixed_probabilities(hypotheses, uniform_mix).detach().argmax(dim=1)
    choice = torch.where(exploit.to(likely.device), likely, explored.to(likely.device))
    return Selection(torch.arange(photos, device=likely.device), choice)


def camera_for(hypotheses: Hypotheses, selection: Selection, *, fov_deg: float, distance: float) -> Camera:
    """Cameras of the selected rows; differentiable in rotation and translation."""
    rotation = hypotheses.rotations[selection.photo, selection.hypothesis]
    return make_camera(rotation, hypotheses.translation[selection.photo], fov_deg=fov_deg, distance=distance)


def _balanced_draw(photos: int, number: int, generator: torch.Generator) -> Int[Tensor, " batch"]:
    """Uniform for each photo, and as even over the batch as possible."""
    start = torch.randint(number, (1,), generator=generator)
    return (torch.randperm(photos, generator=generator) + start) % number
