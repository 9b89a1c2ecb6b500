"""The herd: a deterministic supply of photographs of rigged models, with truth."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial import KDTree

from fauna.data.truth import Truth3D
from fauna.errors import FaunaError
from fauna.models3d.animal import Animal, prepare
from fauna.models3d.coat import paint, paint_eyes
from fauna.models3d.posing import Build, pose_animal, sample_build, sample_moment
from fauna.random import derive_seed
from fauna.zoo.body import KEYPOINTS
from fauna.zoo.products import dot
from fauna.zoo.render import Photo, Subject, photograph, visible
from fauna.zoo.scene import sample_surroundings
from fauna.zoo.view import View, project, sample_view

PHOTOS_PER_INDIVIDUAL = 4
CACHED = 32
"""Prepared models (about 10 MB each), and individuals, kept in memory."""
BEARING = 0.5
"""Share of trunk and legs from which a vertex may rest on the ground."""
EYE_RADIUS = 0.05
"""Of a painted eye, lengths of the head."""
UNDER_SKIN, SKIN = 1.3, 0.06
"""A keypoint counts as seen up to this multiple of its distance from the skin, plus heights at the withers, below it."""
Views = Literal["photographer", "uniform"]


@dataclass(frozen=True)
class HerdSample:
    """One crop.

    Attributes:
        image: background kept, black outside the photo.
        mask: 0 or 255.
        box: ``(x0, y0, width, height, photo_width, photo_height)`` of the crop window, photo pixels.
        activity: name of the clip.
        keypoints: crop pixels and 1 where inside the crop and not hidden, in the order of the zoo's.
        truth: for evaluation only; unit is the model's height at the withers.
    """

    image: UInt8[np.ndarray, "size size 3"]
    mask: UInt8[np.ndarray, "size size"]
    box: tuple[int, int, int, int, int, int]
    activity: str
    keypoints: Float[np.ndarray, "key 3"]
    truth: Truth3D


@dataclass(frozen=True)
class _Individual:
    build: Build
    albedo: np.ndarray
    gloss: np.ndarray


class Herd:
    """Photographs as a pure function of (seed, model, index) and the files of a folder.

    Args:
        root: folder; models lie in it or one folder below.
        seed: of everything random.
        image_size: pixels of the crops, both axes.
        views: ``photographer`` has the zoo's photographers' habits, ``uniform`` walks around the animal evenly.
    """

    def __init__(self, *, root: Path, seed: int, image_size: int, views: Views) -> None:
        if image_size < 16:
            raise FaunaError(f"image_size must be at least 16, received {image_size}; use 256 unless you are testing")
        self.files = model_files(root)
        self.seed = seed
        self.image_size = image_size
        self.views: Views = views
        self._animals: OrderedDict[str, Animal] = OrderedDict()
        self._individuals: OrderedDict[tuple[str, int], _Individual] = OrderedDict()
        self._lock = threading.Lock()  # photographs are drawn by several threads

    def sample(self, model: str, index: int) -> HerdSample:
        """Photograph ``index`` of a model.

        Raises:
            FaunaError: unknown model, negative index or broken file.
        """
        animal, individual, verts, view, activity, truth = self._stage(model, index)
        faces = animal.refinement.faces
        floor = float(verts[animal.girth.sum(1) > BEARING, 1].min())
        subject = Subject(verts, animal.rest, faces, individual.albedo, individual.gloss, animal.openness, floor)
        surroundings = sample_surroundings(self._rng("surroundings", model, index))
        photo: Photo = photograph(subject, view, surroundings, self.image_size, self._rng("grain", model, index))
        keypoints = _seen_keypoints(view, photo, truth, self.image_size)
        return HerdSample(photo.image, photo.mask, view.box, activity, keypoints, truth)

    def truth(self, model: str, index: int) -> Truth3D:
        """What is known of photograph ``index``, without drawing it."""
        return self._stage(model, index)[-1]

    def animal(self, model: str) -> Animal:
        """A prepared model."""
        if model not in self.files:
            raise FaunaError(f"unknown model {model!r}; expected one of {', '.join(self.files)}")
        with self._lock:
            return _kept(self._animals, model, lambda: prepare(self.files[model]))

    def _stage(self, model: str, index: int) -> tuple[Animal, _Individual, np.ndarray, View, str, Truth3D]:
        if index < 0:
            raise FaunaError(f"index must not be negative, received {index}; photos are numbered from 0")
        animal, number = self.animal(model), index // PHOTOS_PER_INDIVIDUAL
        with self._lock:
            individual = _kept(self._individuals, (model, number), lambda: self._grow(model, animal, number))
        clip, time = sample_moment(animal, self._rng("pose", model, index))
        verts, keypoints = pose_animal(animal, individual.build, clip, time)
        faces = animal.refinement.faces
        if self.views == "uniform":
            view = _uniform_view(verts, faces, self._rng("view", model, index))
        else:
            view = sample_view(verts, faces, self._rng("view", model, index))
        truth = Truth3D(
            camera_from_world=view.camera_from_world, clip_from_world=view.clip_from_world, azimuth_deg=view.azimuth_deg,
            elevation_deg=view.elevation_deg, verts=verts, faces=faces, legs=animal.legs, keypoints=keypoints,
        )  # fmt: skip
        return animal, individual, verts, view, "stand" if clip is None else clip.rpartition("|")[2].lower(), truth

    def _grow(self, model: str, animal: Animal, number: int) -> _Individual:
        rng = self._rng("individual", model, number)
        build = sample_build(rng)
        albedo = paint(animal.entry.species, animal.colours, animal.gloss, animal.rest, animal.normals, rng)
        at = dict(zip(KEYPOINTS, animal.keypoints, strict=True))
        eyes = np.stack([at["left_eye"], at["right_eye"]])
        radius = EYE_RADIUS * float(np.linalg.norm(at["nose"] - 0.5 * (at["left_ear"] + at["right_ear"])))
        albedo, gloss = paint_eyes(albedo, animal.gloss, animal.rest, eyes, radius)
        return _Individual(build, albedo, gloss)

    def _rng(self, purpose: str, model: str, index: int) -> np.random.Generator:
        return np.random.default_rng(derive_seed(self.seed, purpose, model, index))


def model_files(root: Path) -> dict[str, Path]:
    """The ``.glb`` files of a folder and the folders in it, by stem, sorted.

    Raises:
        FaunaError: when there is none, or two share a stem.
    """
    found = sorted([*root.glob("*.glb"), *root.glob("*/*.glb")], key=lambda path: path.stem)
    if not found:
        raise FaunaError(
            f"data=models3d expects .glb files in {root} or one folder below, got none; set data.root to a folder of rigged models"
        )
    files = {path.stem: path for path in found}
    if len(files) < len(found):
        twice = next(a for a, b in zip(found, found[1:], strict=False) if a.stem == b.stem)
        raise FaunaError(f"data=models3d expects file names that differ, got {twice.name} twice in {root}; rename one")
    return files


def _uniform_view(verts: Float[np.ndarray, "vert 3"], faces: np.ndarray, rng: np.random.Generator) -> View:
    """A photographer's view of the animal after it has turned by an angle that is evenly distributed."""
    turn = rng.uniform(-180.0, 180.0)
    sine, cosine = np.sin(np.radians(turn)), np.cos(np.radians(turn))
    turned = np.eye(4)
    turned[:3, :3] = [[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]]
    view = sample_view(dot(verts, turned[:3, :3].T), faces, rng)
    return replace(
        view,
        camera_from_world=view.camera_from_world @ turned,
        clip_from_world=view.clip_from_world @ turned,
        azimuth_deg=(view.azimuth_deg + turn + 180.0) % 360.0 - 180.0,
    )


def _kept(cache: OrderedDict, key: Hashable, make: Callable[[], Any]) -> Any:
    """Look up or make; the least recently used entry leaves a full cache."""
    if key not in cache:
        cache[key] = make()
        if len(cache) > CACHED:
            cache.popitem(last=False)
    cache.move_to_end(key)
    return cache[key]


def _seen_keypoints(view: View, photo: Photo, truth: Truth3D, size: int) -> Float[np.ndarray, "key 3"]:
    """Crop pixels of the keypoints and whether they are seen: no farther under the skin than it is away, and a little."""
    known = np.isfinite(truth.keypoints[:, 0])
    points = np.where(known[:, None], truth.keypoints, 0.0)
    away, _ = KDTree(truth.verts).query(points)
    clip = project(view.clip_from_world, points)
    seen = known & visible(view, photo, points, UNDER_SKIN * away + SKIN)
    return np.column_stack([(clip[:, :2] / clip[:, 3:] + 1) * (0.5 * size), seen])
