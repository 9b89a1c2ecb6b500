"""The interface of pose predictors."""

from abc import ABC, abstractmethod

from jaxtyping import Float
from torch import Tensor, nn

from fauna.types import Camera, Features, Pose, Skeleton


class Articulation(nn.Module, ABC):
    """Predicts the bone rotations of each row (supplement, "Bone Rotation Prediction")."""

    @abstractmethod
    def forward(
        self,
        features: Features,
        geometry: Float[Tensor, "row geometry_chan"],
        skeleton: Skeleton,
        camera: Camera,
        *,
        leg_limits: str,
    ) -> Pose:
        """Bone rotations.

        Args:
            features: of each row's photo.
            geometry: geometry embedding of each row's photo.
            skeleton: rest bones, of each row or one for all.
            camera: of each row; receives no gradient.
            leg_limits: a name of :data:`fauna.articulation.constraints.LEG_LIMITS`.
        """
