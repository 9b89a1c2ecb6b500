"""No articulation."""

import torch
from jaxtyping import Float
from torch import Tensor

from fauna.articulation.base import Articulation
from fauna.geometry.skeleton import NUM_BONES
from fauna.types import Camera, Features, Pose, Skeleton


class NoArticulation(Articulation):
    """Leaves every bone at rest."""

    def forward(
        self,
        features: Features,
        geometry: Float[Tensor, "batch geometry_chan"],
        skeleton: Skeleton,
        camera: Camera,
        residual: Float[Tensor, "row height width"] | None = None,
        *,
        leg_limits: str,
    ) -> Pose:
        """All angles zero."""
        return Pose(geometry.new_zeros(camera.camera_from_world.shape[0], skeleton.starts.shape[1], 3))

    def limits(self, leg_limits: str) -> Float[Tensor, "20 3"]:
        """No bone may turn."""
        return torch.zeros(NUM_BONES, 3)
