"""From a reconstruction to a rigged animal."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation
from torch import Tensor

from fauna.errors import FaunaError
from fauna.export.animal import RiggedAnimal, UvTexture
from fauna.export.clips import author_clips
from fauna.export.influences import strongest_influences
from fauna.export.joints import JOINT_OF_BONE, NUM_JOINTS, ROOT
from fauna.geometry.rig import Rig
from fauna.geometry.rotations import euler_xyz_to_matrix
from fauna.geometry.skinning import rest_frames, skinning_weights
from fauna.model import FaunaModel
from fauna.types import Reconstruction, Skeleton

_BONE_AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Columns: the file's bone axes (left, along, left x along) in the model's (right, up, forward)."""

_BACK = 3
"""The bone that starts at the middle of the back."""


@dataclass(frozen=True)
class RestAnimal:
    """What is rigged: one animal at rest and how the photo bends it; world units, canonical frame.

    Attributes:
        verts: (vert, 3) rest mesh.
        faces: (face, 3) counter-clockwise seen from outside.
        skeleton: its rest bones, a batch of one.
        angles: (bone, 3) Euler XYZ of the photo, radians.
        posed: (vert, 3) the model's own posed mesh.
    """

    verts: Float[Tensor, "vert 3"]
    faces: Int[Tensor, "face 3"]
    skeleton: Skeleton
    angles: Float[Tensor, "bone 3"]
    posed: Float[Tensor, "vert 3"]


def rig_reconstruction(
    model: FaunaModel,
    out: Reconstruction,
    *,
    row: int = 0,
    name: str,
    texture: UvTexture | None = None,
    colours: Float[np.ndarray, "vert 3"] | None = None,
    back_height: float = 1.0,
) -> RiggedAnimal:
    """The animal of one row: mesh at rest, named joints, four weights a vertex, the photo's pose and clips.

    Args:
        model: that made the reconstruction; gives the rig.
        out: the reconstruction.
        row: which of its rows.
        name: of the animal in the files.
        texture: atlas and picture of the mesh.
        colours: of the vertices, sRGB in [0, 1], used where there is no texture.
        back_height: metres, see :func:`rig_animal`.

    Raises:
        FaunaError: when ``row`` or ``back_height`` is out of range, or the mesh is empty or not finite.
    """
    if not 0 <= row < len(out.selection.photo):
        raise FaunaError(f"row: expected one of {len(out.selection.photo)} rows, got {row}; count from 0")
    animal = rig_animal(model.rig, _at_rest(model, out, row), name=name, back_height=back_height)
    return replace(animal, texture=texture, colours=None if texture is not None else colours)


def rig_animal(rig: Rig, rest: RestAnimal, *, name: str, back_height: float) -> RiggedAnimal:
    """Change of frame, names and units, four weights a vertex, and clips.

    One photograph has no scale. The animal is made so large that the middle of its back (the root joint) stands
    ``back_height`` metres above the ground, which is the lowest vertex at rest.

    Raises:
        FaunaError: when ``back_height`` is out of range, or the mesh is empty, not finite or has no height.
    """
    if not 0 < back_height < float("inf"):
        raise FaunaError(f"back_height: expected metres above 0, got {back_height}; the default is 1")
    if not len(rest.faces) or not bool(rest.verts.isfinite().all()):
        raise FaunaError("the mesh: expected a finite surface, got none; this reconstruction cannot be exported")
    starts, ends = rest.skeleton.starts[0].numpy(), rest.skeleton.ends[0].numpy()
    back, ground = starts[_BACK], float(rest.verts[:, 1].min())
    if not back[1] > ground:
        raise FaunaError("the mesh: expected a back above the ground, got a flat mesh; it cannot be exported")
    scale, origin = back_height / float(back[1] - ground), np.array([0.0, ground, back[2]])
    vertices = (rest.verts.numpy() - origin) * scale
    influences, weights = strongest_influences(_all_weights(rig, rest), np.asarray(JOINT_OF_BONE))
    animal = RiggedAnimal(
        name=name,
        vertices=vertices,
        faces=rest.faces.numpy().astype(np.int64),
        parents=joint_parents(rest.skeleton.parents[0].numpy()),
        starts=_per_joint((starts - origin) * scale, (back - origin) * scale),
        ends=_per_joint((ends - origin) * scale, (back - origin) * scale),
        frames=_per_joint(rest_frames(rest.skeleton)[0].numpy() @ _BONE_AXES, np.eye(3)),
        influences=influences,
        weights=weights,
        photo=_per_joint(_relative_turns(rest.angles), np.array([0.0, 0.0, 0.0, 1.0])),
        metres_per_unit=scale,
        origin=origin,
        body_length=float(np.ptp(vertices[:, 2])),
        skin_error_max=0.0,
        skin_error_mean=0.0,
    )
    clips, notes = author_clips(animal)
    return replace(_with_error(animal, rest.posed.numpy()), clips=clips, notes=notes)


@torch.no_grad()
def _at_rest(model: FaunaModel, out: Reconstruction, row: int) -> RestAnimal:
    """One row in double precision on the CPU; bones are found here while the model does not articulate yet."""
    photo = int(out.selection.photo[row])
    skeleton = out.skeleton or model.rig.rest(out.instance, legs_attached=True)
    one = torch.tensor([photo if len(skeleton.starts) > 1 else 0], device=skeleton.starts.device)
    skeleton = Skeleton(
        *(values.index_select(0, one).cpu() for values in (skeleton.starts, skeleton.ends, skeleton.parents))
    )
    skeleton = Skeleton(skeleton.starts.double(), skeleton.ends.double(), skeleton.parents)
    angles = torch.zeros_like(skeleton.starts[0]) if out.pose is None else out.pose.angles[row].double().cpu()
    verts = out.instance.verts[photo if len(out.instance.verts) > 1 else 0]
    return RestAnimal(verts.double().cpu(), out.base.faces.cpu(), skeleton, angles, out.posed.verts[row].double().cpu())


def joint_parents(bone_parents: Int[np.ndarray, " bone"]) -> Int[np.ndarray, " joint"]:
    """Parents in the order of the file; what is a root of the model hangs from the root joint."""
    parents = np.full(NUM_JOINTS, ROOT)
    parents[ROOT] = -1
    for bone, parent in enumerate(bone_parents):
        if parent >= 0:
            parents[JOINT_OF_BONE[bone]] = JOINT_OF_BONE[parent]
    return parents


def _all_weights(rig: Rig, rest: RestAnimal) -> Float[np.ndarray, "vert bone"]:
    weights = skinning_weights(
        rest.verts[None], rest.skeleton, temperature=rig.skin_temperature, distance=rig.skin_distance
    )
    return weights[0].numpy()


def _relative_turns(angles: Float[Tensor, "bone 3"]) -> Float[np.ndarray, "bone 4"]:
    """Euler angles about the model's bone axes as quaternions about the file's."""
    turns = _BONE_AXES.T @ euler_xyz_to_matrix(angles).numpy() @ _BONE_AXES
    return Rotation.from_matrix(turns).as_quat(canonical=True)


def _per_joint(
    per_bone: Float[np.ndarray, "bone ..."], root: Float[np.ndarray, "..."]
) -> Float[np.ndarray, "joint ..."]:
    """Values per bone in the order of the joints, with one for the root."""
    values = np.empty((NUM_JOINTS, *root.shape))
    values[ROOT], values[list(JOINT_OF_BONE)] = root, per_bone
    return values


def _with_error(animal: RiggedAnimal, posed: Float[np.ndarray, "vert 3"]) -> RiggedAnimal:
    """Measure the four weights against the model's own posed mesh (world units)."""
    distance = np.linalg.norm(animal.to_world(animal.pose(animal.photo)) - posed, axis=1)
    share = distance * animal.metres_per_unit / animal.body_length
    return replace(animal, skin_error_max=float(share.max()), skin_error_mean=float(share.mean()))
