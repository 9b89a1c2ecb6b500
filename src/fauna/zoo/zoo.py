"""The zoo: a deterministic supply of animal photographs with truth."""

from collections import OrderedDict
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from fauna.errors import FaunaError
from fauna.random import derive_seed
from fauna.zoo.anatomy import Anatomy
from fauna.zoo.beasts import CLAWED
from fauna.zoo.body import KEYPOINTS, Body
from fauna.zoo.build import build_body
from fauna.zoo.coat import paint
from fauna.zoo.palette import COATS
from fauna.zoo.poses import sample_pose
from fauna.zoo.render import FUR_GLOSS, GLOSS, Subject, photograph, visible
from fauna.zoo.scene import Surroundings, sample_surroundings
from fauna.zoo.skinning import bone_transforms, skin
from fauna.zoo.species import HOOFED
from fauna.zoo.surface import Surface, build_surface, vertex_normals
from fauna.zoo.view import project, sample_view

ANATOMY: dict[str, Anatomy] = {**HOOFED, **CLAWED}
SPECIES: tuple[str, ...] = tuple(ANATOMY)
"""Names of all species."""
HELD_OUT: tuple[str, ...] = ("wolf", "camel")
"""Species meant for testing only; their relatives (dog, fox; horse, giraffe) are not held out."""
PHOTOS_PER_INDIVIDUAL = 4
CELLS = 110
"""Samples of an individual's distance field along its longest side."""
CACHED = 24
"""Individuals kept in memory."""
VARIATION = 0.05
"""Standard deviation of an individual's proportions about its species', relative."""


@dataclass(frozen=True)
class ZooTruth:
    """What no photograph tells.

    Attributes:
        species: name.
        individual: number of the individual within its species; split by it.
        activity: what it does.
        camera_from_world: rigid, world = animal frame (x its left, y up, z to the head).
        clip_from_world: of the crop; NDC x right, y down.
        azimuth_deg: 0 faces the camera, 90 heads right, +-180 shows the back.
        elevation_deg: of the camera.
        fov_deg: angle of the crop window.
        posed_verts: unit is the height at the withers at rest.
        rest_verts: standing on y = 0.
        faces: counter-clockwise seen from outside.
        keypoints: posed, in the order of ``keypoint_names``.
        keypoints_2d: NDC of the crop.
        keypoint_visible: inside the crop and not hidden.
        keypoint_names: the names of Animal-Pose.
    """

    species: str
    individual: int
    activity: str
    camera_from_world: Float[np.ndarray, "4 4"]
    clip_from_world: Float[np.ndarray, "4 4"]
    azimuth_deg: float
    elevation_deg: float
    fov_deg: float
    posed_verts: Float[np.ndarray, "vert 3"]
    rest_verts: Float[np.ndarray, "vert 3"]
    faces: Int[np.ndarray, "face 3"]
    keypoints: Float[np.ndarray, "20 3"]
    keypoints_2d: Float[np.ndarray, "20 2"]
    keypoint_visible: Bool[np.ndarray, "20"]
    keypoint_names: tuple[str, ...]


@dataclass(frozen=True)
class ZooSample:
    """One crop, as a photographer's preparation would deliver it.

    Attributes:
        image: background kept, black outside the photo.
        mask: 0 or 255.
        box: ``(x0, y0, width, height, photo_width, photo_height)`` of the crop window, photo pixels.
        truth: for evaluation only.
    """

    image: UInt8[np.ndarray, "size size 3"]
    mask: UInt8[np.ndarray, "size size"]
    box: tuple[int, int, int, int, int, int]
    truth: ZooTruth


@dataclass(frozen=True)
class _Individual:
    body: Body
    surface: Surface
    albedo: np.ndarray
    gloss: np.ndarray
    anchors: dict[str, int]  # vertices that carry the keypoints of the skin
    bearing: np.ndarray  # vertices that may rest on the ground


class Zoo:
    """Photographs as a pure function of (seed, species, index).

    Args:
        seed: of everything random.
        image_size: pixels of the crops, both axes.
    """

    def __init__(self, *, seed: int, image_size: int):
        if image_size < 16:
            raise FaunaError(f"image_size must be at least 16, received {image_size}; use 256 unless you are testing")
        self.seed = seed
        self.image_size = image_size
        self._individuals: OrderedDict[tuple[str, int], _Individual] = OrderedDict()

    def individual(self, species: str, index: int) -> int:
        """Number of the individual on photo ``index`` of a species; consecutive photos show the same one."""
        _check(species, index)
        return index // PHOTOS_PER_INDIVIDUAL

    def surroundings(self, number: int) -> Surroundings:
        """Light and background number ``number`` of one sequence that knows no species; the species take turns along it."""
        return sample_surroundings(np.random.default_rng(derive_seed(self.seed, "surroundings", number)))

    def sample(self, species: str, index: int) -> ZooSample:
        """Photograph ``index`` of a species.

        Raises:
            FaunaError: unknown species or negative index.
        """
        number = self.individual(species, index)
        animal = self._individual(species, number)
        body, surface = animal.body, animal.surface
        activity, angles = sample_pose(body, species, self._rng("pose", species, index))
        transforms = bone_transforms(body.joints, body.parents, angles)
        posed = skin(surface.verts, surface.weights, np.stack([transforms[name] for name in body.joints]))
        view = sample_view(posed, surface.faces, self._rng("view", species, index))
        subject = Subject(
            posed,
            surface.verts,
            surface.faces,
            animal.albedo,
            animal.gloss,
            surface.openness,
            float(posed[animal.bearing, 1].min()),
        )
        surroundings = self.surroundings(index * len(SPECIES) + SPECIES.index(species))
        photo = photograph(subject, view, surroundings, self.image_size, self._rng("grain", species, index))
        places, bones, depths = zip(*(body.keypoints[name] for name in KEYPOINTS), strict=True)
        keypoints = np.stack([(transforms[b] @ np.append(p, 1.0))[:3] for p, b in zip(places, bones, strict=True)])
        for name, vertex in animal.anchors.items():
            keypoints[KEYPOINTS.index(name)] = posed[vertex]
        clip = project(view.clip_from_world, keypoints)
        truth = ZooTruth(
            species, number, activity, view.camera_from_world, view.clip_from_world, view.azimuth_deg, view.elevation_deg, view.fov_deg,
            posed, surface.verts, surface.faces, keypoints, clip[:, :2] / clip[:, 3:],
            visible(view, photo, keypoints, np.array(depths)), KEYPOINTS,
        )  # fmt: skip
        return ZooSample(photo.image, photo.mask, view.box, truth)

    def _rng(self, purpose: str, species: str, index: int) -> np.random.Generator:
        return np.random.default_rng(derive_seed(self.seed, purpose, species, index))

    def _individual(self, species: str, number: int) -> _Individual:
        key = (species, number)
        if key not in self._individuals:
            self._individuals[key] = _grow(species, self._rng("individual", species, number))
            if len(self._individuals) > CACHED:
                self._individuals.popitem(last=False)
        self._individuals.move_to_end(key)
        return self._individuals[key]


def _check(species: str, index: int) -> None:
    if species not in ANATOMY:
        raise FaunaError(f"unknown species {species!r}; expected one of {', '.join(SPECIES)}")
    if index < 0:
        raise FaunaError(f"index must not be negative, received {index}; photos are numbered from 0")


def _grow(species: str, rng: np.random.Generator) -> _Individual:
    anatomy = vary(ANATOMY[species], rng)
    body = build_body(anatomy)
    surface = build_surface(body, cells=CELLS, fleece=anatomy.fleece)
    coat = COATS[species][rng.integers(len(COATS[species]))]
    albedo = paint(coat, body, surface, anatomy, vertex_normals(surface.verts, surface.faces), rng)
    gloss = np.array([GLOSS.get(name, FUR_GLOSS) for name in surface.material_names])[surface.materials]
    return _Individual(body, surface, albedo, gloss, _anchors(body, surface), _bearing(body, surface))


def _anchors(body: Body, surface: Surface) -> dict[str, int]:
    """Vertices on the mirror line nearest to nose, throat and tail, and the top of the withers: they bend with the skin."""
    middle = np.flatnonzero(np.abs(surface.verts[:, 0]) < 0.02)
    line = surface.verts[middle]
    anchors = {}
    for name in ("nose", "throat", "withers", "tailbase"):
        place = body.keypoints[name][0]
        away = np.linalg.norm(line - place, axis=1)
        if name == "withers":
            away = np.where(np.abs(line[:, 2] - place[2]) < 0.02, -line[:, 1], np.inf)
        anchors[name] = int(middle[away.argmin()])
    return anchors


def _bearing(body: Body, surface: Surface) -> np.ndarray:
    """Vertices of trunk and legs."""
    loose = np.array(
        [name.startswith(("neck", "head", "tail", "proboscis")) or name.endswith("ear") for name in body.joints]
    )
    return np.flatnonzero(~loose[surface.weights.argmax(1)])


def vary(anatomy: Anatomy, rng: np.random.Generator) -> Anatomy:
    """An individual of a species: every length varies by ``VARIATION``, angles by four degrees; fat and thin ones differ as a whole."""
    stout = rng.normal(0, 1)
    changes = {}
    for item in fields(anatomy):
        value = getattr(anatomy, item.name)
        if item.name.endswith("_deg"):
            changes[item.name] = value + rng.normal(0, 4.0)
        elif isinstance(value, float):
            changes[item.name] = value * np.exp(rng.normal(0, VARIATION))
    fixed = {
        name: getattr(anatomy, name)
        for name in ("croup", "arch", "knee", "hock", "fetlock", "muzzle_start", "skull", "jaw", "muzzle_drop")
    }
    for name, share in {"belly": 0.05, "width": 0.04, "thigh": 0.06, "neck_root": 0.05}.items():
        changes[name] *= np.exp(share * stout)
    return replace(anatomy, **(changes | fixed))
