"""What is known about an animal in a photograph beyond its mask. For evaluation only: training never sees it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

LEGS = ("left_front", "right_front", "left_back", "right_back")
"""Names of the legs, in the order of the numbers in ``Truth3D.legs``."""


@dataclass(frozen=True)
class Truth3D:
    """Geometry behind one crop.

    World is the animal's own frame: x to its left, y up, z towards the head; any unit. Camera and NDC follow
    ``docs/conventions.md``.

    Attributes:
        camera_from_world: rigid; x right, y up, looks along -z.
        clip_from_world: of the crop; NDC x right, y down.
        azimuth_deg: 0 faces the camera, 90 heads to the right of the image, +-180 shows the back.
        elevation_deg: of the camera above the animal's horizontal plane.
        verts: posed surface.
        faces: counter-clockwise seen from outside.
        legs: index into :data:`LEGS` of each vertex, -1 where it belongs to no leg.
        keypoints: posed, in the order of the dataset's ``keypoint_names``; NaN where the animal has none.
    """

    camera_from_world: Float[np.ndarray, "4 4"]
    clip_from_world: Float[np.ndarray, "4 4"]
    azimuth_deg: float
    elevation_deg: float
    verts: Float[np.ndarray, "vert 3"]
    faces: Int[np.ndarray, "face 3"]
    legs: Int[np.ndarray, " vert"]
    keypoints: Float[np.ndarray, "key 3"]
