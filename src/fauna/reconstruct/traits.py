"""What the model knows an animal by, apart from colour: numbers that can be mixed, and the body that they make.

Interpolation as in the paper (supplement, "Shape Interpolation between Instances"): shape codes and deformation features are mixed
linearly, and every mixture is a body of its own, with bones found on it. Bone rotations take the shortest way instead of a linear mix of angles.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation, Slerp
from torch import Tensor

from fauna.errors import FaunaError
from fauna.export.animal import RiggedAnimal, UvTexture
from fauna.export.rig import RestAnimal, rig_animal
from fauna.model import FaunaModel
from fauna.types import BaseShape, InstanceShape, Pose, PosedMesh, Reconstruction, Skeleton

BACK_HEIGHT = 1.0
"""Metres, as of every exported animal."""


@dataclass(frozen=True, eq=False)
class Traits:
    """An animal without its colours.

    Attributes:
        code: shape code, the answer of the bank.
        geometry: condition of the instance deformation, ``None`` for a base shape as it is.
        angles: (bone, 3) Euler XYZ, radians; zeros at rest.
    """

    code: Float[Tensor, " value_chan"]
    geometry: Float[Tensor, "1 geometry_chan"] | None
    angles: Float[Tensor, "20 3"]


@dataclass(frozen=True, eq=False)
class Body:
    """What traits make: a mesh at rest, its bones, and the mesh in its pose; world units, canonical frame.

    Attributes:
        base: rest mesh of the code.
        instance: rest mesh after deformation.
        skeleton: rest bones.
        angles: (bone, 3) Euler XYZ, radians.
        posed: skinned mesh.
    """

    base: BaseShape
    instance: InstanceShape
    skeleton: Skeleton
    angles: Float[Tensor, "20 3"]
    posed: PosedMesh


def traits_of(out: Reconstruction) -> Traits:
    """Traits of a reconstruction of one photograph."""
    angles = torch.zeros(20, 3).to(out.code) if out.pose is None else out.pose.angles[0]
    return Traits(out.code, None if out.embedding is None else out.embedding.geometry[:1], angles)


def resting(code: Float[Tensor, " value_chan"]) -> Traits:
    """The base shape of a code, at rest."""
    return Traits(code, None, torch.zeros(20, 3).to(code))


def mixed(first: Traits, second: Traits, share: float) -> Traits:
    """Traits between two animals.

    Args:
        first: what a share of 0 gives, exactly.
        second: what a share of 1 gives, exactly.
        share: of the second.
    """
    if share in (0.0, 1.0):
        return second if share else first
    geometry = None
    if first.geometry is not None and second.geometry is not None:
        geometry = torch.lerp(first.geometry, second.geometry, share)
    angles = mixed_angles(first.angles, second.angles, share)
    return Traits(torch.lerp(first.code, second.code, share), geometry, angles)


def mixed_angles(
    first: Float[Tensor, "bone 3"], second: Float[Tensor, "bone 3"], share: float
) -> Float[Tensor, "bone 3"]:
    """Rotations on the shortest way between two poses, bone by bone (slerp), as Euler XYZ angles, radians.

    A linear mix of Euler angles would turn about an axis that wanders and at a speed that changes. Sideways angles stay well within 90 degrees (their
    limit is 60), so that the way back to angles is unique.
    """
    mixes = []
    for one, other in zip(first.double().cpu().numpy(), second.double().cpu().numpy(), strict=True):
        way = Slerp([0.0, 1.0], Rotation.from_euler("XYZ", np.stack([one, other])))
        mixes.append(way(share).as_euler("XYZ"))
    return torch.from_numpy(np.stack(mixes)).to(first)


@torch.no_grad()
def embody(model: FaunaModel, traits: Traits) -> Body:
    """Mesh, bones and pose of traits.

    Args:
        model: in evaluation mode.
        traits: of it.

    Raises:
        FaunaError: when the code has no surface.
    """
    base = model.shape(traits.code, None)
    if not len(base.faces):
        raise FaunaError("the mesh: expected a surface, got none from this mixture; choose another share or seed")
    instance = InstanceShape(base.verts[None])
    if model.stage.deformation and traits.geometry is not None:
        instance = model.deformation(base, traits.geometry)
    skeleton = model.rig.rest(instance, legs_attached=model.stage.legs_attached)
    posed = model.rig.pose(base, instance, skeleton, Pose(traits.angles[None]))
    return Body(base, instance, skeleton, traits.angles, posed)


def rigged(
    model: FaunaModel,
    body: Body,
    *,
    name: str,
    texture: UvTexture | None = None,
    colours: Float[np.ndarray, "vert 3"] | None = None,
) -> RiggedAnimal:
    """The body with named joints, weights and clips; its pose takes the place of the photo's.

    Args:
        model: that made the body.
        body: one.
        name: of the animal in the files.
        texture: atlas and picture of the mesh.
        colours: of the vertices, sRGB in [0, 1], where there is no texture.
    """
    bones = body.skeleton
    rest = RestAnimal(
        body.instance.verts[0].double().cpu(),
        body.base.faces.cpu(),
        Skeleton(bones.starts.double().cpu(), bones.ends.double().cpu(), bones.parents.cpu()),
        body.angles.double().cpu(),
        body.posed.verts[0].double().cpu(),
    )
    animal = rig_animal(model.rig, rest, name=name, back_height=BACK_HEIGHT)
    return replace(animal, texture=texture, colours=None if texture is not None else colours)
