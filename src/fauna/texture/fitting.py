"""Bone angles and camera of a reconstruction as free parameters; shape, skeleton and skinning weights stay."""

from dataclasses import replace
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from fauna.geometry.camera import make_camera
from fauna.model import FaunaModel
from fauna.types import Camera, Hypotheses, Pose, PosedMesh, Reconstruction

SMALLEST_LIMIT = 1e-6
"""Radians; where an angle is fixed at zero."""
_FARTHEST_START = 0.99
"""Share of its limit an angle starts from at most: beyond, it could hardly move."""

Freedom = Literal["angles", "camera", "both"]
Parameters = dict[str, Tensor]
"""``angles``: (row, bone, 3), inverse hyperbolic tangents of shares of the limits; ``turn`` and ``shift``: (row, 3), rotation of
the view in radians and translation in world units."""


class FreePose:
    """A reconstruction as a differentiable function of pose and camera.

    Args:
        model: gives rig, limits and camera; a fit is not freer than the network it stands in for.
        start: reconstruction by the model.
        free: what may change; without articulation ``angles`` changes nothing.

    Attributes:
        parameters: leaves that :meth:`at` turns into the start (angles at their limits are moved inside a little).
    """

    def __init__(self, *, model: FaunaModel, start: Reconstruction, free: Freedom) -> None:
        self.rig = model.rig
        self.view = model.camera
        self.start = start
        self.limits = model.articulation.limits(model.stage.leg_limits).to(start.posed.verts)
        self.weights = None if start.skeleton is None else self.rig.weights(start.instance, start.skeleton)
        initial: Parameters = {}
        if free in ("angles", "both") and start.pose is not None:
            share = start.pose.angles / self.limits.clamp(min=SMALLEST_LIMIT)
            initial["angles"] = torch.atanh(share.clamp(-_FARTHEST_START, _FARTHEST_START))
        if free in ("camera", "both"):
            initial["turn"] = torch.zeros_like(start.camera.camera_from_world[:, :3, 3])
            initial["shift"] = torch.zeros_like(initial["turn"])
        self.parameters = {name: value.clone().requires_grad_() for name, value in initial.items()}

    def at(self, parameters: Parameters) -> tuple[PosedMesh, Camera, Pose | None]:
        """Mesh, camera and pose under the parameters; what is not free stays as it was."""
        posed, camera, pose = self.start.posed, self.start.camera, self.start.pose
        if "angles" in parameters:
            assert self.start.skeleton is not None
            pose = Pose(self.limits * torch.tanh(parameters["angles"]))
            posed = self.rig.pose(self.start.base, self.start.instance, self.start.skeleton, pose, self.weights)
        if "turn" in parameters:
            old = camera.camera_from_world
            rotation = torch.matrix_exp(_cross_matrix(parameters["turn"])) @ old[:, :3, :3]
            camera = make_camera(rotation, self._offset(camera) + parameters["shift"], **self.view)
        return posed, camera, pose

    @torch.no_grad()
    def result(self, parameters: Parameters) -> Reconstruction:
        """The reconstruction under the parameters; its ``renders`` are still those of the start."""
        posed, camera, pose = self.at(parameters)
        chosen = self.start.selection
        hypotheses: Hypotheses = self.start.hypotheses
        rotations, translation = hypotheses.rotations.clone(), hypotheses.translation.clone()
        rotations[chosen.photo, chosen.hypothesis] = camera.camera_from_world[:, :3, :3]
        translation[chosen.photo] = self._offset(camera)
        hypotheses = replace(hypotheses, rotations=rotations, translation=translation)
        return replace(self.start, posed=posed, camera=camera, pose=pose, hypotheses=hypotheses)

    def _offset(self, camera: Camera) -> Float[Tensor, "row 3"]:
        """Of the object from its nominal place."""
        place = camera.camera_from_world[:, :3, 3]
        return place + place.new_tensor((0.0, 0.0, self.view["distance"]))


def _cross_matrix(vector: Float[Tensor, "row 3"]) -> Float[Tensor, "row 3 3"]:
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack((zero, -z, y, z, zero, -x, -y, x, zero), dim=-1).reshape(-1, 3, 3)
