"""Photographs of a posed animal: sun with shadows, sky and bounced light, fur, ground shadow, development to 8 bits."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.ndimage import gaussian_filter, map_coordinates

from fauna.kernels.zoo_raster import rasterise, value_noise
from fauna.zoo.products import dot
from fauna.zoo.scene import Surroundings, background, inside_photo, pixel_rays, sun_in_world
from fauna.zoo.surface import vertex_normals
from fauna.zoo.view import View, project

OVERSAMPLING = 2
"""Samples per pixel and axis of the animal layer."""
SHADOW_MAP = 192
"""Texels of the shadow map per axis."""
GLOSS = {"eye": 0.6, "pupil": 0.9, "nose": 0.25, "hoof": 0.12, "horn": 0.15, "tusk": 0.25}
"""Strength of the highlight by material; the rest is fur with ``FUR_GLOSS``."""
FUR_GLOSS = 0.03


@dataclass(frozen=True)
class Subject:
    """A posed animal ready to be photographed.

    Attributes:
        verts: (vert, 3) posed.
        rest: (vert, 3) where fur is looked up.
        faces: (face, 3).
        albedo: (vert, 3) linear.
        gloss: (vert,) strength of the highlight.
        openness: (vert,) ambient occlusion.
        floor: height of the ground it stands on.
    """

    verts: Float[np.ndarray, "vert 3"]
    rest: Float[np.ndarray, "vert 3"]
    faces: Int[np.ndarray, "face 3"]
    albedo: Float[np.ndarray, "vert 3"]
    gloss: Float[np.ndarray, " vert"]
    openness: Float[np.ndarray, " vert"]
    floor: float


@dataclass(frozen=True)
class Photo:
    """What the camera recorded: image, mask and the depth that decides visibility.

    Attributes:
        image: (size, size, 3).
        mask: (size, size) 0 or 255.
        depth: (size * OVERSAMPLING, ...) NDC depth, +inf off the animal.
    """

    image: UInt8[np.ndarray, "size size 3"]
    mask: UInt8[np.ndarray, "size size"]
    depth: Float[np.ndarray, "fine fine"]


def photograph(
    subject: Subject, view: View, surroundings: Surroundings, size: int, noise: np.random.Generator
) -> Photo:
    """Render one crop.

    Args:
        subject: posed animal.
        view: camera and crop.
        surroundings: light and background.
        size: pixels of the crop, both axes.
        noise: grain of the sensor, consumed.
    """
    fine = size * OVERSAMPLING
    clip = project(view.clip_from_world, subject.verts)
    index, bary, depth = rasterise(clip, subject.faces, fine, fine)
    covered = index >= 0
    shadow = _ShadowMap(subject, sun_in_world(surroundings, view))
    layer = np.zeros((fine, fine, 3))
    layer[covered] = _shade(subject, view, surroundings, shadow, subject.faces[index[covered]], bary[covered])
    colour, coverage = _shrink(layer), _shrink(covered[..., None].astype(float))
    rays = pixel_rays(view, size)
    behind, points = background(surroundings, view, rays, subject.floor)
    behind = behind * _ground_light(subject, surroundings, shadow, points)
    valid = inside_photo(view, size)
    image = _develop(colour + behind * (1 - coverage), surroundings, noise) * valid[..., None]
    mask = np.where((coverage[..., 0] >= 0.5) & valid, 255, 0).astype(np.uint8)
    return Photo(np.rint(255 * image).astype(np.uint8), mask, depth)


def visible(
    view: View, photo: Photo, points: Float[np.ndarray, "point 3"], depths: Float[np.ndarray, " point"]
) -> Bool[np.ndarray, " point"]:
    """Whether points no deeper than ``depths`` under the surface can be seen in the crop."""
    toward = np.linalg.inv(view.camera_from_world)[:3, 3] - points
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    seen, lifted = (
        project(view.clip_from_world, points),
        project(view.clip_from_world, points + depths[:, None] * toward),
    )
    fine = photo.depth.shape[0]
    at = np.floor((seen[:, :2] / seen[:, 3:] + 1) * 0.5 * fine).astype(int)
    inside = ((at >= 0) & (at < fine)).all(1)
    column, row = np.clip(at, 0, fine - 1).T
    at_photo = inside_photo(view, fine)[row, column]
    return inside & at_photo & (lifted[:, 2] / lifted[:, 3] <= photo.depth[row, column])


def _shrink(layer: np.ndarray) -> np.ndarray:
    size = layer.shape[0] // OVERSAMPLING
    return layer.reshape(size, OVERSAMPLING, size, OVERSAMPLING, -1).mean((1, 3))


class _ShadowMap:
    """Depth from the sun over the animal, and its blurred outline for the ground."""

    def __init__(self, subject: Subject, sun: np.ndarray):
        centre = 0.5 * (subject.verts.min(0) + subject.verts.max(0))
        radius = 1.02 * np.linalg.norm(subject.verts - centre, axis=1).max()
        right = np.cross([0.0, 1.0, 0.0], sun)
        right /= np.linalg.norm(right)
        rows = np.stack([right, -np.cross(sun, right), -sun]) / radius
        self.matrix = np.eye(4)
        self.matrix[:3, :3], self.matrix[:3, 3] = rows, -rows @ centre
        self.sun = sun
        index, _, self.depth = rasterise(project(self.matrix, subject.verts), subject.faces, SHADOW_MAP, SHADOW_MAP)
        self.outline = (index >= 0).astype(float)
        self.bias = 0.03 / radius

    def _texels(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        clip = project(self.matrix, points)
        return ((clip[:, :2] + 1) * 0.5 * SHADOW_MAP - 0.5)[:, ::-1].T, clip[:, 2]

    def light(self, points: np.ndarray) -> np.ndarray:
        """Share of the sun that reaches points of the animal."""
        at, depth = self._texels(points)
        at = np.clip(np.rint(at).astype(int), 1, SHADOW_MAP - 2)
        free = [depth - self.bias <= self.depth[at[0] + i, at[1] + j] for i in (-1, 0, 1) for j in (-1, 0, 1)]
        return np.mean(free, 0)

    def ground_light(self, points: np.ndarray, softness: float) -> np.ndarray:
        """Share of the sun that reaches points below the animal."""
        blurred = gaussian_filter(self.outline, SHADOW_MAP * (0.006 + 0.03 * softness))
        return 1 - map_coordinates(blurred, self._texels(points)[0], order=1, mode="constant")


def _shade(
    subject: Subject, view: View, s: Surroundings, shadow: _ShadowMap, corners: np.ndarray, bary: np.ndarray
) -> np.ndarray:
    normals = vertex_normals(subject.verts, subject.faces)
    table = np.concatenate(
        [normals, subject.verts, subject.rest, subject.albedo, subject.gloss[:, None], subject.openness[:, None]], 1
    )
    values = sum(table[corners[:, i]] * bary[:, i : i + 1] for i in range(3))
    normal, place, rest, albedo, gloss, openness = np.split(values, (3, 6, 9, 12, 13), 1)
    fur = value_noise(rest * [70, 28, 70], 2, s.seed % 1000)[:, None] - 0.5
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    eye = np.linalg.inv(view.camera_from_world)[:3, 3]
    toward = eye - place
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    half = toward + shadow.sun
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    wrap = 0.15 + 0.35 * s.softness
    sun = (
        np.clip((dot(normal, shadow.sun) + wrap) / (1 + wrap), 0, 1)
        * (s.softness + (1 - s.softness) * shadow.light(place))
    )[:, None]
    up = 0.5 + 0.5 * normal[:, 1:2]
    open_ = 0.35 + 0.65 * openness
    light = sun * s.sun_colour + open_ * (up * s.sky_colour + (1 - up) * s.bounce)
    shine = np.clip((normal * half).sum(1, keepdims=True), 0, 1) ** np.where(gloss > 0.2, 60.0, 12.0)
    rim = 0.05 * (1 - np.clip((normal * toward).sum(1, keepdims=True), 0, 1)) ** 3
    return (
        albedo * (1 + 0.5 * fur * (gloss < 0.1)) * light
        + (gloss * shine * sun + rim * open_) * (s.sun_colour + s.sky_colour) * 0.7
    )


def _ground_light(subject: Subject, s: Surroundings, shadow: _ShadowMap, points: np.ndarray) -> np.ndarray:
    """Light on the background relative to an empty scene: the shadow of the animal and the dark under its feet."""
    out = np.ones((*points.shape[:2], 1))
    hit = np.isfinite(points[..., 0])
    if not hit.any():
        return out
    at, reach = points[hit], 0.45 * np.ptp(subject.verts[:, 1])
    low = subject.verts[subject.verts[:, 1] < subject.floor + reach]
    first, extent = low[:, [0, 2]].min(0) - 0.6, np.ptp(low[:, [0, 2]], axis=0) + 1.2
    cells = 64
    weight = np.clip(1 - (low[:, 1] - subject.floor) / reach, 0, 1)
    histogram = np.histogram2d(
        *((low[:, [0, 2]] - first) / extent).T, bins=cells, range=((0, 1), (0, 1)), weights=weight
    )[0]
    dark = gaussian_filter(np.minimum(histogram / 3.0, 1.0), 1.6)
    contact = map_coordinates(dark, ((at[:, [0, 2]] - first) / extent * cells - 0.5).T, order=1, mode="constant")
    direct = (s.sun_colour * s.sun[1]).mean()
    ambient = s.sky_colour.mean()
    lit = (ambient * (1 - 0.6 * np.clip(contact, 0, 1)) + direct * shadow.ground_light(at, s.softness)) / (
        ambient + direct
    )
    out[hit] = lit[:, None]
    return out


def _develop(linear_rgb: np.ndarray, s: Surroundings, noise: np.random.Generator) -> np.ndarray:
    """Exposure, shoulder, gamma and grain; values in [0, 1]."""
    exposed = 0.95 * linear_rgb
    toned = np.where(exposed < 0.7, exposed, 0.7 + 0.3 * (1 - np.exp(-(exposed - 0.7) / 0.3)))
    image = np.clip(toned, 0, 1) ** (1 / 2.2)
    return np.clip(image + noise.normal(0, 0.008, image.shape), 0, 1)
