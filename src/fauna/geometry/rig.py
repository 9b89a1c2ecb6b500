"""The rig: how rest bones are placed and how they carry the surface."""

from dataclasses import dataclass
from typing import Literal

from jaxtyping import Float
from torch import Tensor

from fauna.geometry.half_turn import half_turn, turn_skeleton
from fauna.geometry.skeleton import SkeletonOptions, rest_skeleton
from fauna.geometry.skinning import bone_transforms, posed_bones, skin, skinning_weights
from fauna.types import BaseShape, InstanceShape, Pose, PosedMesh, Skeleton


@dataclass(frozen=True)
class Rig:
    """Choices of skeleton and skinning (supplement, "Adaptive Bone Topology" and "Skinning Weights").

    Attributes:
        skeleton: how joints are found on the rest mesh.
        skin_temperature: tau_s of the softmax over bones, world units (or their square).
        skin_distance: ``squared`` point-to-bone distance (paper) or ``euclidean`` (published code).
        turned: the model was learned with the head at -z, see :mod:`fauna.geometry.half_turn`: bones are found in the frame
            it learned with (the heuristic is not quite the same at both ends) and named as they lie.
    """

    skeleton: SkeletonOptions
    skin_temperature: float
    skin_distance: Literal["euclidean", "squared"]
    turned: bool = False

    def rest(self, instance: InstanceShape, *, legs_attached: bool) -> Skeleton:
        """Rest bones of each instance, without gradient."""
        verts = half_turn(instance.verts.detach(), self.turned)
        found = rest_skeleton(verts, options=self.skeleton, legs_attached=legs_attached)
        return turn_skeleton(found) if self.turned else found

    def weights(self, instance: InstanceShape, skeleton: Skeleton) -> Float[Tensor, "batch vert bone"]:
        """Skinning weights of each instance, without gradient."""
        return skinning_weights(
            instance.verts.detach(), skeleton, temperature=self.skin_temperature, distance=self.skin_distance
        )

    def pose(
        self,
        base: BaseShape,
        instance: InstanceShape,
        skeleton: Skeleton,
        pose: Pose,
        weights: Float[Tensor, "batch vert bone"] | None = None,
    ) -> PosedMesh:
        """Linear blend skinning of each row.

        Args:
            base: gives the faces.
            instance: rest mesh of each photo, or one for all. Skinning weights are computed per mesh, not per row.
            skeleton: rest bones of each photo, or one for all.
            pose: bone angles of each row; rows are photo-major.
            weights: of :meth:`weights`, when they are at hand: they do not depend on the pose.
        """
        weights = self.weights(instance, skeleton) if weights is None else weights
        transforms = bone_transforms(skeleton, pose.angles)
        starts, ends = posed_bones(skeleton, transforms)
        return PosedMesh(skin(instance.verts, weights, transforms), base.faces, base.verts, starts, ends)
