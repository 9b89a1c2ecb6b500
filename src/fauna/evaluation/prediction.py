"""What a model says about one photograph, in the form that is stored and scored. Needs no model to be read."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8


@dataclass(frozen=True)
class Prediction:
    """Reconstruction of one crop, with the most likely viewpoint.

    World, camera and NDC follow ``docs/conventions.md`` (x the animal's left, y up, z the end the model calls its head).

    Attributes:
        name: of the photo, unique within the dataset.
        category: species.
        verts: posed surface, world units.
        canonical: base-shape position of each vertex, before deformation and pose, world units.
        faces: counter-clockwise seen from outside.
        bone: strongest bone of each vertex; -1 while the model does not articulate.
        local: position of each vertex in the frame of that bone: distance along the bone in bone lengths (0 at the joint
            nearer to the body), and two coordinates across it in bone lengths; equal to ``canonical`` without bones.
        camera_from_world: rigid.
        clip_from_world: NDC x right, y down.
        silhouette: antialiased coverage, 0 to 255.
        probabilities: of each viewpoint hypothesis.
        forwards: (hyp, 3) direction of the animal's +z axis in the camera frame under each hypothesis.
        angles: (bone, 3) Euler angles, radians; (0, 3) while the model does not articulate.
    """

    name: str
    category: str
    verts: Float[np.ndarray, "vert 3"]
    canonical: Float[np.ndarray, "vert 3"]
    faces: Int[np.ndarray, "face 3"]
    bone: Int[np.ndarray, " vert"]
    local: Float[np.ndarray, "vert 3"]
    camera_from_world: Float[np.ndarray, "4 4"]
    clip_from_world: Float[np.ndarray, "4 4"]
    silhouette: UInt8[np.ndarray, "size size"]
    probabilities: Float[np.ndarray, " hyp"]
    forwards: Float[np.ndarray, "hyp 3"]
    angles: Float[np.ndarray, "bone 3"]
