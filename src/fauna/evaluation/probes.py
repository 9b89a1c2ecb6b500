"""Probes: bone angles, camera or both fitted to the mask of each photograph, the shape left as predicted.

They separate causes of error: what the silhouette gains when only the pose is freed is the pose's share. The fit sees the mask it is
scored against, so it is *not* a feed-forward result and never a headline.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast, get_args

import torch

from fauna.data.photos import Photo
from fauna.errors import FaunaError
from fauna.evaluation.baselines.base import Bench, Reconstruct
from fauna.evaluation.predict import prediction_of
from fauna.evaluation.prediction import Prediction
from fauna.model import FaunaModel
from fauna.renderer.deferred import render_silhouette
from fauna.texture.fitting import Freedom, FreePose
from fauna.types import Batch, Reconstruction


@dataclass(frozen=True)
class ProbeOptions:
    """How a probe is fitted.

    Attributes:
        steps: of Adam.
        lr: learning rate; angles in units of their limits, rotations in radians, translations in world units.
    """

    steps: int
    lr: float


def check_probes(names: Sequence[str]) -> list[Freedom]:
    """The probes of a list; unknown ones are refused.

    Raises:
        FaunaError: naming the first.
    """
    for name in names:
        if name not in get_args(Freedom):
            raise FaunaError(
                f"probes: expected names among {', '.join(get_args(Freedom))}, got {name!r}; correct the list"
            )
    return [cast(Freedom, name) for name in names]


def probe(bench: Bench, free: Freedom, options: ProbeOptions) -> Reconstruct:
    """A function that fits a photograph.

    Args:
        bench: the model and its data.
        free: what may change.
        options: of the optimiser.
    """
    model = bench.model

    def reconstruct(photo: Photo) -> Prediction:
        out = fit(model, bench.data.single(photo).to(model.device), free, options)
        return prediction_of(model.rig, model.renderer, out, name=photo.name, category=photo.category, size=bench.size)

    return reconstruct


def fit(model: FaunaModel, photo: Batch, free: Freedom, options: ProbeOptions) -> Reconstruction:
    """The reconstruction whose free part fits the mask best (squared error of the silhouette), never worse than the start.

    Args:
        model: in evaluation mode.
        photo: batch of one.
        free: what may change; without articulation ``angles`` changes nothing.
        options: of the optimiser.
    """
    with torch.no_grad():
        start = model(photo)
    size = (photo.masks.shape[-2], photo.masks.shape[-1])
    pose = FreePose(model=model, start=start, free=free)
    best, lowest = start, math.inf
    optimizer = torch.optim.Adam(pose.parameters.values(), lr=options.lr) if pose.parameters else None
    for step in range(options.steps + 1):
        posed, camera, _ = pose.at(pose.parameters)
        silhouette = render_silhouette(model.renderer, posed, camera, size, topology=start.base.topology)
        loss = ((silhouette - photo.masks) * photo.valid).square().mean()
        error = float(loss.detach())
        if error < lowest:
            best, lowest = pose.result(pose.parameters), error
        if step == options.steps or optimizer is None:
            break
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return best
