"""Camera of a crop and the viewpoint it has of the animal.

The centre of a crop need not lie on the optical axis of the photo it was cut from, and a single crop does not tell. Everything in the
camera frame is therefore compared in the frame of the *crop camera*: the camera turned, by the least rotation, to look along the ray
through the crop's centre. For a camera that looks at the crop's centre already, as a model's does, nothing changes.
"""

import numpy as np
from jaxtyping import Float

from fauna.errors import FaunaError


def crop_camera(
    camera_from_world: Float[np.ndarray, "4 4"], clip_from_world: Float[np.ndarray, "4 4"]
) -> tuple[Float[np.ndarray, "4 4"], float]:
    """Rigid transform into the frame of the crop camera, and its focal length.

    Returns:
        ``crop_from_world``: x right, y up, looks along -z through the centre of the crop.
        ``focal``: NDC units per unit of x / -z near the centre.

    Raises:
        FaunaError: the projection has no perspective.
    """
    camera_from_world = camera_from_world.astype(np.float64)
    clip_from_camera = clip_from_world.astype(np.float64) @ np.linalg.inv(camera_from_world)
    if not clip_from_camera[3, :3].any():
        raise FaunaError(
            "expected a perspective camera, got one whose w is constant; store clip_from_world with perspective"
        )
    ray = np.cross(clip_from_camera[0, :3], clip_from_camera[1, :3])  # where NDC x and y are both 0
    ray *= np.sign(clip_from_camera[3, :3] @ ray) / np.linalg.norm(ray)
    turn = np.eye(4)
    turn[:3, :3] = _least_rotation(ray, np.array([0.0, 0.0, -1.0]))
    clip_from_crop = clip_from_camera @ turn.T
    slopes = clip_from_crop[:2, :2] / -clip_from_crop[3, 2]
    return turn @ camera_from_world, float(np.sqrt(abs(np.linalg.det(slopes))))


def viewpoint(camera_from_world: Float[np.ndarray, "4 4"]) -> tuple[float, float]:
    """Azimuth and elevation in degrees: where a camera stands in the animal's frame, looking back along its axis.

    Azimuth 0: the animal faces the camera, 90: it heads to the right of the image. A roll of the camera changes neither. Of a photo's
    camera these are the angles of :class:`~fauna.data.truth.Truth3D`; of its crop camera, what the crop shows.
    """
    toward = camera_from_world[2, :3].astype(np.float64)  # the camera's backward axis in world coordinates
    toward = toward / np.linalg.norm(toward)
    azimuth = np.degrees(np.arctan2(-toward[0], toward[2]))
    return float(azimuth), float(np.degrees(np.arcsin(np.clip(toward[1], -1, 1))))


def wrap_degrees(angle: float) -> float:
    """The same direction in [-180, 180).

    >>> wrap_degrees(350.0)
    -10.0
    """
    return (angle + 180.0) % 360.0 - 180.0


def front_back_flip(predicted_deg: float, true_deg: float) -> bool:
    """Whether an animal that clearly shows its front (or back) is seen from the other end.

    Clear is an azimuth within 60 degrees of the front or of the back; then the predicted one is nearer to the true azimuth mirrored at
    the image plane than to the true one. A half turn is both a front-back and a left-right flip.
    """
    true, predicted = np.cos(np.radians([true_deg, predicted_deg]))
    return bool(abs(true) >= 0.5 and true * predicted < 0)


def left_right_flip(predicted_deg: float, true_deg: float) -> bool:
    """Whether an animal that clearly heads to one side (within 60 degrees) is seen heading to the other; see above."""
    true, predicted = np.sin(np.radians([true_deg, predicted_deg]))
    return bool(abs(true) >= 0.5 and true * predicted < 0)


def _least_rotation(start: np.ndarray, end: np.ndarray) -> Float[np.ndarray, "3 3"]:
    """Rotation of one unit vector onto another that is not its opposite (Rodrigues)."""
    axis = np.cross(start, end)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + cross + cross @ cross / (1.0 + start @ end)
