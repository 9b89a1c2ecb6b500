"""From a model to a :class:`~fauna.evaluation.prediction.Prediction`: one photo at a time, as at test time.

Each photo has its own base shape (a batch of one), the most likely viewpoint is taken, nothing is mirrored or averaged.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fauna.errors import FaunaError
from fauna.evaluation.prediction import Prediction
from fauna.geometry.rig import Rig
from fauna.geometry.skinning import rest_frames, skinning_weights
from fauna.model import FaunaModel
from fauna.renderer.base import Renderer
from fauna.renderer.deferred import render_silhouette
from fauna.types import Batch, Camera, PosedMesh, Reconstruction, Skeleton

SHORTEST_BONE = 1e-6
"""World units; shorter bones count as this long where lengths divide."""


@dataclass(frozen=True)
class BoneCoordinates:
    """Where each vertex lies on the skeleton.

    Attributes:
        bone: (vert,) strongest bone, -1 without a skeleton.
        local: (vert, 3) along the bone, to its right, upwards; in bone lengths, 0 at the joint nearer to the body.
    """

    bone: np.ndarray
    local: np.ndarray


@torch.no_grad()
def predict(model: FaunaModel, photo: Batch, *, category: str, size: int) -> tuple[Prediction, Reconstruction]:
    """Reconstruct one photo.

    Args:
        model: in evaluation mode.
        photo: batch of one.
        category: species, as the dataset calls it.
        size: side of the stored silhouette, pixels; independent of the resolution the model was trained at.

    Returns:
        The prediction, and all that the model said, at the resolution of the batch.

    Raises:
        FaunaError: when the batch holds another number of photos than one.
    """
    if len(photo.names) != 1:
        raise FaunaError(f"predict: expected a batch of one photo, got {len(photo.names)}; pass them one by one")
    out: Reconstruction = model(photo)
    return prediction_of(model.rig, model.renderer, out, name=photo.names[0], category=category, size=size), out


@torch.no_grad()
def prediction_of(
    rig: Rig, renderer: Renderer, out: Reconstruction, *, name: str, category: str, size: int
) -> Prediction:
    """The stored form of the first row of a reconstruction.

    Args:
        rig: whose skinning weights say which bone a vertex belongs to.
        renderer: draws the silhouette.
        out: with one row.
        name: of the photo.
        category: species.
        size: side of the silhouette, pixels.
    """
    rest = out.instance.verts[:1]
    place = bone_coordinates(rig, rest, out.base.verts, out.skeleton)
    angles = np.zeros((0, 3), np.float32) if out.pose is None else _numpy(out.pose.angles[0])
    return assemble(
        renderer,
        out.posed,
        out.camera,
        place,
        name=name,
        category=category,
        size=size,
        probabilities=_numpy(out.hypotheses.probabilities[0]),
        forwards=_numpy(out.hypotheses.rotations[0, :, :, 2]),
        angles=angles,
    )


@torch.no_grad()
def assemble(
    renderer: Renderer,
    posed: PosedMesh,
    camera: Camera,
    place: BoneCoordinates,
    *,
    name: str,
    category: str,
    size: int,
    probabilities: Float[np.ndarray, " hyp"],
    forwards: Float[np.ndarray, "hyp 3"],
    angles: Float[np.ndarray, "bone 3"],
) -> Prediction:
    """A prediction from its parts; baselines and probes exchange some of them.

    Args:
        renderer: draws the silhouette.
        posed: mesh of one row.
        camera: of one row.
        place: bone labels and coordinates of its vertices.
        name: of the photo.
        category: species.
        size: side of the silhouette, pixels.
        probabilities: of the viewpoint hypotheses.
        forwards: directions of +z under each.
        angles: of the bones, radians.
    """
    silhouette = render_silhouette(renderer, posed, camera, (size, size))[0]
    return Prediction(
        name=name,
        category=category,
        verts=_numpy(posed.verts[0]),
        canonical=_numpy(posed.canonical),
        faces=posed.faces.detach().cpu().numpy().astype(np.int32),
        bone=place.bone,
        local=place.local,
        camera_from_world=_numpy(camera.camera_from_world[0]),
        clip_from_world=_numpy(camera.clip_from_world[0]),
        silhouette=(silhouette.clamp(0, 1) * 255).round().to(torch.uint8).cpu().numpy(),
        probabilities=probabilities,
        forwards=forwards,
        angles=angles,
    )


@torch.no_grad()
def bone_coordinates(
    rig: Rig, rest: Float[Tensor, "1 vert 3"], canonical: Float[Tensor, "vert 3"], skeleton: Skeleton | None
) -> BoneCoordinates:
    """Strongest bone of each rest vertex and its coordinates in that bone's rest frame.

    Args:
        rig: temperature and distance of the skinning weights.
        rest: instance before posing, world units.
        canonical: base-shape positions, returned as coordinates where there are no bones.
        skeleton: rest bones, ``None`` while the model does not articulate.
    """
    if skeleton is None:
        return BoneCoordinates(np.full(len(canonical), -1, np.int32), _numpy(canonical))
    first = Skeleton(skeleton.starts[:1], skeleton.ends[:1], skeleton.parents[:1])
    weights = skinning_weights(rest, first, temperature=rig.skin_temperature, distance=rig.skin_distance)
    bone = weights[0].argmax(dim=1)
    start, length = first.starts[0, bone], (first.ends - first.starts)[0].norm(dim=1).clamp_min(SHORTEST_BONE)[bone]
    right_up_forward = torch.einsum("vij,vi->vj", rest_frames(first)[0, bone], rest[0] - start) / length[:, None]
    local = right_up_forward[:, [2, 0, 1]]
    return BoneCoordinates(bone.cpu().numpy().astype(np.int32), _numpy(local))


def _numpy(tensor: Tensor) -> np.ndarray:
    return tensor.detach().cpu().float().numpy()
