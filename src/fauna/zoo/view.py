"""The photographer: where the camera stands, how the photo is framed and how the square crop is cut from it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from fauna.data.crop_window import crop_window
from fauna.kernels.zoo_raster import rasterise
from fauna.zoo.products import dot

NEAR, FAR = 0.1, 1000.0
PHOTO_SIZES = ((1024, 768), (1200, 800), (900, 900), (768, 1024), (1280, 720))
"""Width and height of the photos."""
PROBE = 256
"""Longer side of the raster on which the area of the mask is measured."""


@dataclass(frozen=True)
class View:
    """A camera and its square crop.

    Attributes:
        camera_from_world: rigid; x right, y up, looks along -z.
        clip_from_world: of the crop; NDC x right, y down.
        box: crop window and photo size ``(x0, y0, width, height, photo_width, photo_height)``, photo pixels.
        azimuth_deg: 0 faces the camera, 90 heads to the right of the image, +-180 shows the back.
        elevation_deg: of the camera above the animal's horizontal plane.
        fov_deg: angle of the crop window.
    """

    camera_from_world: Float[np.ndarray, "4 4"]
    clip_from_world: Float[np.ndarray, "4 4"]
    box: tuple[int, int, int, int, int, int]
    azimuth_deg: float
    elevation_deg: float
    fov_deg: float


def project(
    clip_from_world: Float[np.ndarray, "4 4"], points: Float[np.ndarray, "point 3"]
) -> Float[np.ndarray, "point 4"]:
    """Homogeneous clip positions."""
    return dot(points, clip_from_world[:, :3].T) + clip_from_world[:, 3]


def sample_azimuth_deg(rng: np.random.Generator) -> float:
    """Photographers prefer sides and front three-quarters; 7 % are seen from behind."""
    kind = rng.choice(4, p=(0.50, 0.33, 0.10, 0.07))
    angle = (rng.normal(90, 13), rng.uniform(25, 68), rng.normal(0, 12), rng.uniform(125, 180))[kind]
    return float(angle * rng.choice((-1, 1)))


def sample_view(verts: Float[np.ndarray, "vert 3"], faces: Int[np.ndarray, "face 3"], rng: np.random.Generator) -> View:
    """Place a camera, frame the animal, cut the crop.

    Args:
        verts: posed mesh.
        faces: its triangles.
        rng: consumed.
    """
    azimuth, elevation, roll = sample_azimuth_deg(rng), rng.triangular(-3, 5, 20), rng.normal(0, 1.5)
    subtended = np.radians(rng.uniform(15, 45))
    width, height = PHOTO_SIZES[rng.integers(len(PHOTO_SIZES))]
    centre = 0.5 * (verts.min(0) + verts.max(0))
    radius = float(np.linalg.norm(verts - centre, axis=1).max())
    rotation = _rotation(np.radians(azimuth), np.radians(elevation), np.radians(roll))
    aim = centre + rotation.T @ np.array([*(rng.uniform(-0.22, 0.22, 2) * radius), 0.0])
    camera = np.eye(4)
    camera[:3, :3] = rotation
    camera[:3, 3] = -rotation @ aim - [0, 0, radius / np.sin(0.5 * subtended)]
    seen = project(camera, verts)
    slopes = seen[:, :2] / -seen[:, 2:3]
    fit = min(0.5 * width / np.abs(slopes[:, 0]).max(), 0.5 * height / np.abs(slopes[:, 1]).max())
    focal = min(0.98 * fit, rng.uniform(0.42, 0.74) * min(width, height) / (1.1 * np.ptp(slopes, axis=0).max()))
    photo = _clip_from_camera(2 * focal / width, 2 * focal / height) @ camera
    left, top, side = _cut(project(photo, verts), faces, width, height)
    cut = np.eye(4)
    cut[0, 0], cut[0, 3] = width / side, (width - 2 * left) / side - 1
    cut[1, 1], cut[1, 3] = height / side, (height - 2 * top) / side - 1
    fov = float(np.degrees(2 * np.arctan(0.5 * side / focal)))
    return View(camera, cut @ photo, (left, top, side, side, width, height), azimuth, float(elevation), fov)


def _rotation(azimuth: float, elevation: float, roll: float) -> np.ndarray:
    """Rows right, up, back of the camera in the animal's frame."""
    back = np.array([-np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])
    right = np.cross([0.0, 1.0, 0.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    return np.stack([np.cos(roll) * right + np.sin(roll) * up, np.cos(roll) * up - np.sin(roll) * right, back])


def _clip_from_camera(scale_x: float, scale_y: float) -> np.ndarray:
    depth = (-(FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR))
    return np.array([[scale_x, 0, 0, 0], [0, -scale_y, 0, 0], [0, 0, *depth], [0, 0, -1, 0]])


def _cut(clip: np.ndarray, faces: np.ndarray, width: int, height: int) -> tuple[int, int, int]:
    scale = PROBE / max(width, height)
    rows, columns = round(height * scale), round(width * scale)
    covered = rasterise(clip, faces, rows, columns)[0] >= 0
    row, column = np.nonzero(covered)
    per_row, per_column = height / rows, width / columns
    pixels = (clip[:, :2] / clip[:, 3:] + 1) * 0.5 * [width, height]
    bounds = (*pixels.min(0), *pixels.max(0))
    centroid = ((column.mean() + 0.5) * per_column, (row.mean() + 0.5) * per_row)
    return crop_window(len(row) * per_row * per_column, centroid, bounds)
