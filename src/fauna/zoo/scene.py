"""Surroundings: sky or wall, ground, clutter and light. Drawn from a stream that knows nothing of the species."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter

from fauna.kernels.zoo_raster import value_noise
from fauna.zoo.coat import linear, smoothstep
from fauna.zoo.products import dot
from fauna.zoo.view import View

GROUNDS = {
    "grass": ("#4f6b2a", "#7d8f45"), "dry grass": ("#a58f52", "#c9b57c"), "sand": ("#c2a878", "#dcc9a0"), "soil": ("#5d4a39", "#836a50"),
    "snow": ("#c9d0d8", "#eceff2"), "road": ("#66645f", "#88857e"), "leaves": ("#59462a", "#8f6a34"), "meadow": ("#5c7d35", "#a5a84f"),
    "parquet": ("#8a5f3a", "#a87a4c"), "concrete": ("#8d8b86", "#a9a7a1"),
}  # fmt: skip
SKIES = {
    "blue": ("#5e8fc7", "#c3d8ea"), "pale": ("#a9bccb", "#dfe4e6"), "grey": ("#8f9599", "#bfc3c4"), "evening": ("#7d7a9a", "#e2b48a"),
    "white": ("#d5d8da", "#eceded"), "wall": ("#b9ae9c", "#c9c0b0"), "green wall": ("#7f9182", "#93a595"), "dark": ("#3a4038", "#59604f"),
}  # fmt: skip
CLUTTERS = ("#2f4527", "#4c5e31", "#6b6a45", "#7a6a50", "#55606b", "#3d3a33", "#84806f")


@dataclass(frozen=True)
class Surroundings:
    """Everything in a photo but the animal and the camera.

    Attributes:
        ground: two linear colours.
        sky: colours at the zenith and at the horizon.
        clutter: colour of the bushes, hills or furniture behind.
        clutter_height: their mean height, radians above the horizon; 0 for none.
        clutter_scale: how many of them fit in a radian.
        grain: size of the ground's coarsest texture, withers heights.
        contrast: of the ground's texture.
        clouds: amount of clouds.
        blur: defocus of what is behind, fraction of the image.
        sun: direction towards the sun in the camera's horizontal frame (x right, y up, z to the camera).
        sun_colour: linear, scaled by its strength.
        sky_colour: light from above.
        bounce: light from below.
        softness: of the shadows, 0 hard to 1 overcast.
        seed: of the textures.
    """

    ground: Float[np.ndarray, "2 3"]
    sky: Float[np.ndarray, "2 3"]
    clutter: Float[np.ndarray, "3"]
    clutter_height: float
    clutter_scale: float
    grain: float
    contrast: float
    clouds: float
    blur: float
    sun: Float[np.ndarray, "3"]
    sun_colour: Float[np.ndarray, "3"]
    sky_colour: Float[np.ndarray, "3"]
    bounce: Float[np.ndarray, "3"]
    softness: float
    seed: int


def sample_surroundings(rng: np.random.Generator) -> Surroundings:
    """Draw surroundings; all that is random comes from ``rng``."""
    ground = np.stack([linear(c) for c in GROUNDS[str(rng.choice(list(GROUNDS)))]]) * rng.uniform(0.7, 1.15)
    sky = np.stack([linear(c) for c in SKIES[str(rng.choice(list(SKIES)))]]) * rng.uniform(0.8, 1.1)
    turn, height = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(22, 70))
    softness, warmth = float(rng.beta(1.2, 1.5)), rng.uniform(-0.5, 1)
    strength = 1.45 * (1 - 0.8 * softness)
    sun_colour = strength * np.array([1 + 0.08 * warmth, 1.0, 1 - 0.16 * warmth])
    sky_colour = (0.42 + 0.5 * softness) * (0.55 + 0.45 * sky[0] / sky[0].mean())
    return Surroundings(
        ground=ground, sky=sky, clutter=linear(str(rng.choice(CLUTTERS))) * rng.uniform(0.6, 1.2),
        clutter_height=float(rng.choice((0.0, 1.0), p=(0.2, 0.8)) * rng.uniform(0.01, 0.3)), clutter_scale=rng.uniform(3, 25),
        grain=rng.uniform(0.25, 1.5), contrast=rng.uniform(0.3, 1.0), clouds=rng.uniform(0, 1), blur=rng.uniform(0.002, 0.02),
        sun=np.array([np.sin(turn) * np.cos(height), np.sin(height), np.cos(turn) * np.cos(height)]),
        sun_colour=sun_colour, sky_colour=sky_colour, bounce=0.55 * ground.mean(0) * (strength + 0.4), softness=softness,
        seed=int(rng.integers(2**30)),
    )  # fmt: skip


def sun_in_world(surroundings: Surroundings, view: View) -> Float[np.ndarray, "3"]:
    """Direction towards the sun in the animal's frame: the light is bound to the photographer, not to the animal."""
    right = view.camera_from_world[0, :3] * [1, 0, 1]
    right = right / np.linalg.norm(right)
    return surroundings.sun @ np.stack([right, [0.0, 1.0, 0.0], np.cross(right, [0.0, 1.0, 0.0])])


def pixel_rays(view: View, size: int) -> Float[np.ndarray, "size size 3"]:
    """Directions, in the world, through the pixel centres of the crop."""
    at = (2 * np.arange(size) + 1) / size - 1
    clip_from_camera = view.clip_from_world @ np.linalg.inv(view.camera_from_world)
    x = (at + clip_from_camera[0, 2]) / clip_from_camera[0, 0]
    y = (at + clip_from_camera[1, 2]) / clip_from_camera[1, 1]
    rays = np.stack([*np.meshgrid(x, y), -np.ones((size, size))], -1)
    return dot(rays, view.camera_from_world[:3, :3])


def inside_photo(view: View, size: int) -> Bool[np.ndarray, "size size"]:
    """Which pixels of the crop come from inside the photo."""
    left, top, side, _, width, height = view.box
    at = (np.arange(size) + 0.5) / size * side
    column, row = left + at, top + at
    return ((row >= 0) & (row < height))[:, None] & ((column >= 0) & (column < width))[None]


def background(
    surroundings: Surroundings, view: View, rays: Float[np.ndarray, "size size 3"], floor: float
) -> tuple[Float[np.ndarray, "size size 3"], Float[np.ndarray, "size size 3"]]:
    """Linear colours behind the animal, without its shadow.

    Args:
        surroundings: what to draw.
        view: camera.
        rays: from :func:`pixel_rays`.
        floor: height of the ground, world units.

    Returns:
        Colours, and the points on the ground (NaN above the horizon).
    """
    s, size = surroundings, rays.shape[0]
    eye = -view.camera_from_world[:3, :3].T @ view.camera_from_world[:3, 3]
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    falls = rays[..., 1] < -1e-4
    distance = np.where(falls, (floor - eye[1]) / np.where(falls, rays[..., 1], 1), np.nan)
    points = eye + rays * distance[..., None]
    sky = _sky(s, view, rays)
    ground = _ground(s, points, distance, size)
    near = falls & (distance > 0) & (distance < 80)
    far = gaussian_filter(sky, (s.blur * size, s.blur * size, 0))
    fade = smoothstep(80.0, 25.0, np.where(near, distance, 80))[..., None]
    return np.where(near[..., None], ground * fade + far * (1 - fade), far), np.where(near[..., None], points, np.nan)


def _sky(s: Surroundings, view: View, rays: np.ndarray) -> np.ndarray:
    frame = view.camera_from_world[:3, :3] * [1, 0, 1]
    bearing = np.arctan2(dot(rays, frame[0]), -dot(rays, frame[2]))
    height = np.arcsin(np.clip(rays[..., 1], -1, 1))
    up = smoothstep(-0.05, 0.6, height)[..., None]
    colour = s.sky[1] + (s.sky[0] - s.sky[1]) * up
    at = np.stack([bearing * 3, height * 9, np.zeros_like(height)], -1).reshape(-1, 3)
    cloud = smoothstep(0.45, 0.75, value_noise(at, 4, s.seed)).reshape(height.shape)[..., None]
    colour = colour + (s.sky.max() * 1.1 - colour) * 0.5 * s.clouds * cloud
    if s.clutter_height > 0:
        outline = value_noise(
            np.stack([bearing * s.clutter_scale, 0 * bearing, 0 * bearing], -1).reshape(-1, 3), 4, s.seed + 1
        )
        top = s.clutter_height * (0.3 + 1.4 * outline.reshape(height.shape))
        at = np.stack([bearing * 2 * s.clutter_scale, height * 2 * s.clutter_scale, 0 * height], -1).reshape(-1, 3)
        texture = value_noise(at, 4, s.seed + 2).reshape(height.shape)[..., None]
        colour = np.where((height < top)[..., None], s.clutter * (0.35 + 1.3 * texture), colour)
    return colour


def _ground(s: Surroundings, points: np.ndarray, distance: np.ndarray, size: int) -> np.ndarray:
    at = np.nan_to_num(points, nan=0.0).clip(-200, 200).reshape(-1, 3) * [1, 0, 1]
    coarse = value_noise(at / s.grain, 4, s.seed + 3).reshape(size, size)
    fine = value_noise(at / (0.06 * s.grain), 3, s.seed + 4).reshape(size, size)
    fine = 0.5 + (fine - 0.5) * smoothstep(30.0, 4.0, np.nan_to_num(distance, nan=30.0))
    mix = np.clip(0.5 + s.contrast * (1.6 * (coarse - 0.5) + 1.4 * (fine - 0.5)), 0, 1)[..., None]
    return s.ground[0] + (s.ground[1] - s.ground[0]) * mix
