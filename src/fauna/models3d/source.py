"""``data=models3d``: the photographs of a herd as a collection of photos."""

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from fauna.data.fauna_folder import CategoryPhotos
from fauna.data.feature_cache import default_cache_root
from fauna.data.photos import Photo, PhotoSource, RawPhoto
from fauna.data.picture_cache import Drawing, read_or_draw
from fauna.data.sources import PhotoCollection, zoo_digest
from fauna.data.truth import Truth3D
from fauna.errors import FaunaError
from fauna.models3d.catalogue import CATALOGUE, CC_BY, Entry, lookup
from fauna.models3d.herd import PHOTOS_PER_INDIVIDUAL, Herd, Views, model_files
from fauna.models3d.load import load_model
from fauna.zoo.body import KEYPOINTS


class Models3D(PhotoCollection):
    """A folder of rigged ``.glb`` models, photographed when first needed; pictures are kept on disk.

    Args:
        root: folder; models lie in it or one folder below.
        seed: of the individuals and their photographs.
        photos_per_model: number of photographs of each model.
        image_size: side of a crop, pixels.
        views: ``photographer`` or ``uniform``, see :class:`fauna.models3d.herd.Herd`.
        models: stems of the files to use, ``None`` = all.
        test_families: families whose photographs are all test photographs of their species, whatever the split says.
        include_cc_by: use models whose licence asks for attribution too; say so where the weights are passed on.
    """

    def __init__(
        self,
        *,
        root: str | None,
        seed: int,
        photos_per_model: int,
        image_size: int,
        views: Views,
        models: list[str] | None,
        test_families: list[str],
        include_cc_by: bool,
    ) -> None:
        if root is None:
            raise FaunaError(
                "data.root: expected a folder of rigged .glb models, got none; give data.root=FOLDER (what fits: docs/data.md), "
                "or use data=zoo, which runs at once"
            )
        self.root = Path(root).expanduser()
        files = model_files(self.root)
        unknown = sorted(set(models or ()) - set(files))
        if unknown:
            raise FaunaError(f"data.source.models: expected names among {', '.join(files)}, got {unknown}")
        self.entries = {name: _entry(files[name]) for name in models or files}
        if models is None:
            self.entries = {name: each for name, each in self.entries.items() if each.twin not in self.entries}
        if not include_cc_by:
            self.entries = {name: each for name, each in self.entries.items() if each.licence != CC_BY}
        families = {entry.family for entry in self.entries.values()}
        if unknown := sorted(set(test_families) - families):
            raise FaunaError(f"data.source.test_families: expected names among {sorted(families)}, got {unknown}")
        self.seed = seed
        self.photos_per_model = photos_per_model
        self.image_size = image_size
        self.views: Views = views
        self.test_families = tuple(test_families)

    def categories(self) -> dict[str, CategoryPhotos]:
        """Photos per species, models of a species taking turns; all photographs of an individual share a ``photograph``."""
        train: dict[str, list[Photo]] = {}
        test: dict[str, list[Photo]] = {}
        for index in range(self.photos_per_model):
            for name, entry in self.entries.items():
                chosen = test if entry.family in self.test_families else train
                chosen.setdefault(entry.species, []).append(self._photo(name, entry, index))
        return {
            species: CategoryPhotos(species, train=tuple(train.get(species, ())), test=tuple(test.get(species, ())))
            for species in sorted({*train, *test})
        }

    def _photo(self, model: str, entry: Entry, index: int) -> Photo:
        return Photo(
            name=f"models3d/{model}/{index:05d}",
            category=entry.species,
            photograph=f"models3d/{model}/individual-{index // PHOTOS_PER_INDIVIDUAL}",
            source=Models3DSource(str(self.root), self.seed, self.image_size, self.views, model, index),
        )

    @property
    def identity(self) -> str:
        """Sizes and a digest of the models' names."""
        text = "|".join((*self.entries, "", *self.test_families))
        digest = hashlib.blake2b(text.encode(), digest_size=4).hexdigest()
        return f"models3d-{self.seed}-{self.image_size}-{self.photos_per_model}-{len(self.entries)}-{digest}"

    @property
    def keypoint_names(self) -> tuple[str, ...]:
        """The names of Animal-Pose."""
        return KEYPOINTS


@dataclass(frozen=True)
class Models3DSource(PhotoSource):
    """One photograph of a rigged model.

    Attributes:
        root: folder of the models.
        seed: of the herd.
        image_size: side of the crop, pixels.
        views: habits of the photographer.
        model: stem of the file.
        index: of the photograph.
    """

    root: str
    seed: int
    image_size: int
    views: Views
    model: str
    index: int

    def read(self) -> RawPhoto:
        """From the cache, or drawn and then cached."""
        key = self.content_key()
        return read_or_draw(default_cache_root() / "models3d" / key[:2] / f"{key}.png", self._draw)

    def content_key(self) -> str:
        """Digest of the model's file, the photograph's place in the herd and the code that draws it."""
        file = model_files(Path(self.root)).get(self.model)
        if file is None:
            raise FaunaError(f"{self.root} expects the model {self.model}.glb, got none; restore it")
        donor = file.with_name(f"{CATALOGUE[self.model].donor}.glb") if self.model in CATALOGUE else file
        content = f"{_file_digest(file)}|{_file_digest(donor) if donor.is_file() else ''}"
        place = f"{self.seed}|{self.image_size}|{self.views}|{self.model}|{self.index}"
        return hashlib.blake2b(f"models3d|{herd_digest()}|{content}|{place}".encode(), digest_size=16).hexdigest()

    def pictured(self) -> str:
        """The individual, wherever the folder lies."""
        return f"models3d|{self.seed}|{self.model}|{self.index // PHOTOS_PER_INDIVIDUAL}"

    def truth(self) -> Truth3D:
        """Geometry behind the crop."""
        return _herd(self.root, self.seed, self.image_size, self.views).truth(self.model, self.index)

    def _draw(self) -> Drawing:
        sample = _herd(self.root, self.seed, self.image_size, self.views).sample(self.model, self.index)
        return sample.image, sample.mask, sample.box, sample.keypoints


@lru_cache(maxsize=1)
def herd_digest() -> str:
    """Digest of the code that draws the herd, the zoo's included."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    own = hashlib.blake2b(b"".join(file.read_bytes() for file in files), digest_size=8).hexdigest()
    return f"{own}{zoo_digest()}"


@lru_cache(maxsize=4)
def _herd(root: str, seed: int, image_size: int, views: Views) -> Herd:
    return Herd(root=Path(root), seed=seed, image_size=image_size, views=views)


def _entry(file: Path) -> Entry:
    """What is known of a file; unknown ones are read to find their rig."""
    return CATALOGUE[file.stem] if file.stem in CATALOGUE else lookup(load_model(file))


def _file_digest(file: Path) -> str:
    state = file.stat()
    return _digest_at(str(file), state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=256)
def _digest_at(file: str, changed: int, size: int) -> str:
    return hashlib.blake2b(Path(file).read_bytes(), digest_size=8).hexdigest()
