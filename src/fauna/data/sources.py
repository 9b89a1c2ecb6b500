"""Data sources: what ``data=zoo`` and ``data=fauna`` have in common is that they list photos per species."""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from fauna.data.fauna_folder import CategoryPhotos, expect_keypoints, read_fauna_folder, read_keypoint_names
from fauna.data.feature_cache import default_cache_root
from fauna.data.packed import is_packed, read_packed
from fauna.data.photos import Photo, PhotoSource, RawPhoto
from fauna.data.picture_cache import Drawing, read_or_draw
from fauna.data.readers.keypoints import canonical_names
from fauna.data.truth import LEGS, Truth3D
from fauna.errors import FaunaError


class PhotoCollection(ABC):
    """Lists the photos of a dataset without opening them."""

    @abstractmethod
    def categories(self) -> dict[str, CategoryPhotos]:
        """Photos per species; raises FaunaError when there are none."""

    @property
    @abstractmethod
    def identity(self) -> str:
        """Names the dataset, e.g. in the default place of its split file."""

    @property
    def keypoint_names(self) -> tuple[str, ...] | None:
        """Names of the keypoints that ``RawPhoto.keypoints`` and ``Truth3D.keypoints`` list, ``None`` without keypoints."""
        return None

    @property
    def left_out(self) -> tuple[tuple[str, str], ...]:
        """(name, reason) of every annotation that :meth:`categories` does not list although the dataset has it."""
        return ()


class FaunaFolder(PhotoCollection):
    """Crops stored as files or packed in shards.

    Args:
        root: dataset folder, see :mod:`fauna.data.fauna_folder` and :mod:`fauna.data.packed`.
        photograph_pattern: how a stem names the photograph it was cropped from; shards know.
    """

    def __init__(self, *, root: str | None, photograph_pattern: str) -> None:
        if root is None:
            raise FaunaError(
                "data.root: expected a dataset folder with <species>/train/<name>_rgb.jpg and <name>_mask.png, got none; "
                "give data.root=FOLDER (how to prepare one: docs/data.md), or use data=zoo, which runs at once"
            )
        self.root = Path(root).expanduser().resolve()  # names and the split file follow the folder, not a link to it
        self.photograph_pattern = photograph_pattern

    def categories(self) -> dict[str, CategoryPhotos]:
        """Photos per species."""
        names = self.keypoint_names
        number = None if names is None else len(names)
        if is_packed(self.root):
            return {name: expect_keypoints(photos, number) for name, photos in read_packed(self.root).items()}
        return read_fauna_folder(self.root, photograph_pattern=self.photograph_pattern, num_keypoints=number)

    @property
    def identity(self) -> str:
        """Folder name and a digest of its full path."""
        digest = hashlib.blake2b(str(self.root).encode(), digest_size=6).hexdigest()
        return f"{self.root.name}-{digest}"

    @property
    def keypoint_names(self) -> tuple[str, ...] | None:
        """From ``keypoint_names.json`` in the folder, under their canonical names."""
        names = read_keypoint_names(self.root)
        return None if names is None else canonical_names(names)


class ZooPhotos(PhotoCollection):
    """The procedural animals of :mod:`fauna.zoo`, drawn when first needed and kept on disk.

    Args:
        seed: of the animals and their photographs.
        photos_per_species: number of photographs of each species.
        image_size: side of a crop, pixels.
        species: the species to use, ``None`` = all.
        few_shot: number of photographs of those species that have another number, e.g. of rare ones; ``None`` = of none.

    Raises:
        FaunaError: for an unknown species, or one without a photograph.
    """

    def __init__(
        self,
        *,
        seed: int,
        photos_per_species: int,
        image_size: int,
        species: list[str] | None,
        few_shot: Mapping[str, int] | None = None,
    ) -> None:
        from fauna.zoo import SPECIES

        self.few_shot = dict(few_shot or {})
        unknown = sorted({*(species or ()), *self.few_shot} - set(SPECIES))
        if unknown:
            raise FaunaError(f"data.source.species: expected names among {', '.join(SPECIES)}, got {unknown}")
        if min(self.few_shot.values(), default=1) < 1:
            raise FaunaError(
                f"data.source.few_shot: expected at least one photograph of each species, got {self.few_shot}; "
                "leave species out with data.source.species"
            )
        self.seed = seed
        self.photos_per_species = photos_per_species
        self.image_size = image_size
        self.species = tuple(species or SPECIES)

    def categories(self) -> dict[str, CategoryPhotos]:
        """Photos per species; all photographs of one individual share a ``photograph``, so splits are by individual."""
        zoo = _zoo(self.seed, self.image_size)
        found = {}
        for species in sorted(self.species):
            photos = tuple(
                Photo(
                    name=f"{species}/{index:05d}",
                    category=species,
                    photograph=f"{species}/individual-{zoo.individual(species, index)}",
                    source=ZooSource(self.seed, self.image_size, species, index),
                )
                for index in range(self.few_shot.get(species, self.photos_per_species))
            )
            found[species] = CategoryPhotos(species, train=photos)
        return found

    @property
    def identity(self) -> str:
        """Seed and sizes."""
        rare = "".join(f"-{species}{number}" for species, number in sorted(self.few_shot.items()))
        return f"zoo-{self.seed}-{self.image_size}-{self.photos_per_species}-{len(self.species)}{rare}"

    @property
    def keypoint_names(self) -> tuple[str, ...]:
        """The twenty of Animal-Pose."""
        from fauna.zoo.body import KEYPOINTS

        return KEYPOINTS


@dataclass(frozen=True)
class ZooSource(PhotoSource):
    """One photograph of the zoo.

    Attributes:
        seed: of the zoo.
        image_size: side of the crop, pixels.
        species: name.
        index: of the photograph.
    """

    seed: int
    image_size: int
    species: str
    index: int

    def read(self) -> RawPhoto:
        """From the cache, or drawn and then cached."""
        key = self.content_key()
        return read_or_draw(default_cache_root() / "zoo" / key[:2] / f"{key}.png", self._draw)

    def content_key(self) -> str:
        """Digest of the seed, the photograph's place in the zoo and the code that draws it."""
        text = f"zoo|{zoo_digest()}|{self.seed}|{self.image_size}|{self.species}|{self.index}"
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()

    def pictured(self) -> str:
        """The individual: more photographs, or larger ones, of the same zoo show the same animals."""
        return f"zoo|{self.seed}|{self.species}|{_zoo(self.seed, self.image_size).individual(self.species, self.index)}"

    def truth(self) -> Truth3D:
        """Camera, posed surface, legs (vertices whose largest skin weight is a leg's bone) and keypoints; drawn again."""
        zoo = _zoo(self.seed, self.image_size)
        truth = zoo.sample(self.species, self.index).truth
        animal = zoo._individual(self.species, truth.individual)  # what carries the skin is no part of a photograph
        of_bone = np.array([_leg(name) for name in animal.body.joints])
        return Truth3D(
            truth.camera_from_world, truth.clip_from_world, truth.azimuth_deg, truth.elevation_deg,
            truth.posed_verts, truth.faces, of_bone[animal.surface.weights.argmax(axis=1)], truth.keypoints,
        )  # fmt: skip

    def _draw(self) -> Drawing:
        sample = _zoo(self.seed, self.image_size).sample(self.species, self.index)
        pixels = (sample.truth.keypoints_2d + 1) * (0.5 * self.image_size)
        return sample.image, sample.mask, sample.box, np.column_stack([pixels, sample.truth.keypoint_visible])


def _leg(bone: str) -> int:
    """Index into ``LEGS`` of the leg that a bone of the zoo belongs to, -1 for none."""
    return next((index for index, leg in enumerate(LEGS) if bone.startswith(leg)), -1)


@lru_cache(maxsize=1)
def zoo_digest() -> str:
    """Digest of the code that draws the zoo: pictures and features made by other code are never taken for its own."""
    import fauna.zoo

    folder = Path(fauna.zoo.__file__).parent
    files = [*sorted(folder.glob("*.py")), *sorted((folder.parent / "kernels").glob("zoo_*.py"))]
    return hashlib.blake2b(b"".join(file.read_bytes() for file in files), digest_size=8).hexdigest()


@lru_cache(maxsize=4)
def _zoo(seed: int, image_size: int):  # noqa: ANN202
    from fauna.zoo import Zoo

    return Zoo(seed=seed, image_size=image_size)
