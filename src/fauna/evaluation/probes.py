"""Probes: bone angles, camera or both fitted to the mask of each photograph, the shape left as predicted.

They separate causes of error: what the silhouette gains when only the pose is freed is the pose's share. The fit sees the mask it is
scored against, so it is *not* a feed-forward result and never a headline.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, cast, get_args

import torch
from jaxtyping import Float
from torch import Tensor

from fauna.data.photos import Photo
from fauna.errors import FaunaError
from fauna.evaluation.baselines.base import Bench, Reconstruct
from fauna.evaluation.predict import prediction_of
from fauna.evaluation.prediction import Prediction
from fauna.geometry.camera import make_camera
from fauna.model import FaunaModel
from fauna.renderer.deferred import render_silhouette
from fauna.types import Batch, Camera, InstanceShape, Pose, PosedMesh, Reconstruction

SMALLEST_LIMIT = 1e-6
"""Radians; where an angle is fixed at zero."""

Freedom = Literal["angles", "camera", "both"]


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
    parameters = _parameters(model, start, free)
    best, lowest = start, math.inf
    optimizer = torch.optim.Adam(parameters.values(), lr=options.lr) if parameters else None
    for step in range(options.steps + 1):
        posed, camera, pose = _apply(model, start, parameters)
        silhouette = render_silhouette(model.renderer, posed, camera, size, topology=start.base.topology)
        loss = ((silhouette - photo.masks) * photo.valid).square().mean()
        error = float(loss.detach())
        if error < lowest:
            best, lowest = _detached(start, posed, camera, pose), error
        if step == options.steps or optimizer is None:
            break
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return best


def _parameters(model: FaunaModel, start: Reconstruction, free: Freedom) -> dict[str, Tensor]:
    parameters: dict[str, Tensor] = {}
    if free in ("angles", "both") and start.pose is not None:
        share = start.pose.angles / _limits(model).clamp(min=SMALLEST_LIMIT)
        parameters["angles"] = torch.atanh(share.clamp(-0.99, 0.99))
    if free in ("camera", "both"):
        parameters["turn"] = torch.zeros_like(start.camera.camera_from_world[:, :3, 3])
        parameters["shift"] = torch.zeros_like(parameters["turn"])
    return {name: value.clone().requires_grad_() for name, value in parameters.items()}


def _limits(model: FaunaModel) -> Float[Tensor, "bone 3"]:
    """What the model itself may predict: a probe is not freer than the network it stands in for."""
    return model.articulation.limits(model.stage.leg_limits).to(model.device)


def _apply(
    model: FaunaModel, start: Reconstruction, parameters: dict[str, Tensor]
) -> tuple[PosedMesh, Camera, Pose | None]:
    """Mesh, camera and pose under the parameters; what is not free stays as predicted."""
    posed, camera, pose = start.posed, start.camera, start.pose
    if "angles" in parameters:
        assert start.skeleton is not None
        pose = Pose(_limits(model) * torch.tanh(parameters["angles"]))
        posed = model.rig.pose(start.base, InstanceShape(start.instance.verts[:1]), start.skeleton, pose)
    if "turn" in parameters:
        old = start.camera.camera_from_world
        rotation = torch.matrix_exp(_cross_matrix(parameters["turn"])) @ old[:, :3, :3]
        distance = model.camera["distance"]
        place = old[:, :3, 3] + old.new_tensor((0.0, 0.0, distance)) + parameters["shift"]
        camera = make_camera(rotation, place, fov_deg=model.camera["fov_deg"], distance=distance)
    return posed, camera, pose


def _cross_matrix(vector: Float[Tensor, "row 3"]) -> Float[Tensor, "row 3 3"]:
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack((zero, -z, y, z, zero, -x, -y, x, zero), dim=-1).reshape(-1, 3, 3)


def _detached(start: Reconstruction, posed: PosedMesh, camera: Camera, pose: Pose | None) -> Reconstruction:
    return replace(
        start,
        posed=replace(posed, verts=posed.verts.detach()),
        camera=Camera(camera.camera_from_world.detach(), camera.clip_from_world.detach()),
        pose=None if pose is None else Pose(pose.angles.detach()),
        hypotheses=replace(start.hypotheses, rotations=_first_turned(start, camera)),
    )


def _first_turned(start: Reconstruction, camera: Camera) -> Tensor:
    """Hypotheses with the chosen one replaced by the fitted rotation."""
    rotations = start.hypotheses.rotations.clone()
    chosen = int(start.selection.hypothesis[0])
    rotations[0, chosen] = camera.camera_from_world[0, :3, :3].detach()
    return rotations
