"""The interface of pose predictors."""

from abc import ABC, abstractmethod

from jaxtyping import Float
from torch import Tensor, nn

from fauna.types import Camera, Features, Pose, Skeleton


class Articulation(nn.Module, ABC):
    """Predicts the bone rotations of each row (supplement, "Bone Rotation Prediction").

    Attributes:
        compares_outline: whether :meth:`forward` reads ``residual``, which costs one more silhouette per row.
        turned: learned with the head at -z, see :mod:`fauna.geometry.half_turn`.
    """

    compares_outline: bool = False
    turned: bool = False

    @abstractmethod
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
        """Bone rotations.

        Args:
            features: of each photo.
            geometry: geometry embedding of each photo.
            skeleton: rest bones, of each photo or one for all.
            camera: of each row, photo-major; receives no gradient.
            residual: mask minus silhouette of the mesh at rest, of each row; ``None`` unless :attr:`compares_outline`.
            leg_limits: a name of :data:`fauna.articulation.constraints.LEG_LIMITS`.
        """

    @abstractmethod
    def limits(self, leg_limits: str) -> Float[Tensor, "20 3"]:
        """Largest absolute angle of every bone about every axis, radians.

        Args:
            leg_limits: a name of :data:`fauna.articulation.constraints.LEG_LIMITS`.
        """
