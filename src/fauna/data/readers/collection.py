"""What the readers of keypoint datasets have in common: from annotated animals to photos, and an account of what was left out."""

import hashlib
import re
import unicodedata
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from fauna.data.fauna_folder import SPLITS, CategoryPhotos
from fauna.data.photos import Photo
from fauna.data.readers.animal import Animal, LeftOut
from fauna.data.readers.crop import CropSource, clip_box, widen_box
from fauna.data.readers.files import find_image, forward_slashes
from fauna.data.readers.keypoints import canonical_names
from fauna.data.sources import PhotoCollection
from fauna.errors import FaunaError


@dataclass(frozen=True)
class _Listing:
    categories: dict[str, CategoryPhotos]
    left_out: tuple[tuple[str, str], ...]
    clipped: tuple[str, ...]


class KeypointPhotos(PhotoCollection):
    """Photographs with annotated animals; a crop is cut around each when it is read.

    Args:
        root: dataset folder.
        images: folder of the photographs below it.
        crop_size: side of a crop, pixels.
        box_margin: how far the box of an animal without mask is widened on each side, shares of its larger side: for boxes that
            only hold the keypoints.
        box_fill: share of that box that the animal is taken to cover; both place the crop, nothing else.
        species: the species to use, ``None`` = all.
    """

    def __init__(
        self,
        *,
        root: str | None,
        images: str,
        crop_size: int,
        box_margin: float,
        box_fill: float,
        species: list[str] | None,
    ) -> None:
        if root is None:
            raise FaunaError(
                "data.root: expected the folder of a keypoint dataset, got none; give data.root=FOLDER (formats: docs/data.md)"
            )
        if crop_size < 1:
            raise FaunaError(f"data.source.crop_size: expected a whole number >= 1, got {crop_size}; e.g. 256")
        if not 0.0 < box_fill <= 1.0:
            raise FaunaError(f"data.source.box_fill: expected a share in (0, 1], got {box_fill}; e.g. 0.57")
        if box_margin < 0.0:
            raise FaunaError(f"data.source.box_margin: expected a share >= 0, got {box_margin}; e.g. 0.15")
        self.root = Path(root).expanduser().resolve()  # names and the split file follow the folder, not a link to it
        self.images = self.root / images
        self.crop_size = crop_size
        self.box_margin = box_margin
        self.box_fill = box_fill
        self.species = None if species is None else tuple(species)

    @abstractmethod
    def animals(self, split: str) -> Iterator[Animal | LeftOut]:
        """Annotated animals of ``train``, ``val`` or ``test``; nothing for a split without annotations."""

    @abstractmethod
    def read_keypoint_names(self) -> tuple[str, ...] | None:
        """Names of the keypoints as the files spell them, ``None`` when nothing has keypoints."""

    skips_bad: bool = False
    """Whether an annotation that cannot be read is left out instead of ending the reading: for sets that nobody has looked through."""

    def entry(self, name: str, read: Callable[[], Animal | LeftOut]) -> Animal | LeftOut:
        """What ``read`` makes of an annotation; where :attr:`skips_bad` is set and it cannot, the annotation left out with the reason."""
        try:
            return read()
        except (FaunaError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            if not self.skips_bad:
                raise
            told = str(error) if isinstance(error, FaunaError) else f"{type(error).__name__} {error}"
            return LeftOut(name, " ".join(told.split())[:200])

    @property
    @abstractmethod
    def sources(self) -> Sequence[str]:
        """The annotation files below the root, for the identity of the dataset."""

    @cached_property
    def raw_keypoint_names(self) -> tuple[str, ...] | None:
        """As the files spell them; :attr:`keypoint_names` is in the same order."""
        return self.read_keypoint_names()

    @property
    def keypoint_names(self) -> tuple[str, ...] | None:
        """Canonical names, see :mod:`fauna.data.readers.keypoints`."""
        return None if self.raw_keypoint_names is None else canonical_names(self.raw_keypoint_names)

    @property
    def identity(self) -> str:
        """Folder name and a digest of its full path, the annotation files and the chosen species."""
        text = "\n".join([str(self.root), *self.sources, "species", *(self.species or ())])
        return f"{self.root.name}-{hashlib.blake2b(text.encode(), digest_size=6).hexdigest()}"

    def categories(self) -> dict[str, CategoryPhotos]:
        """Photos per species in alphabetical order, each list sorted by photograph and annotation.

        Raises:
            FaunaError: when annotations are missing or broken, no photograph is there, or no animal can be used.
        """
        return self._listing.categories

    @property
    def left_out(self) -> tuple[tuple[str, str], ...]:
        """(name, reason) of the annotations that cannot be used; those of species not asked for are not counted."""
        return self._listing.left_out

    @property
    def clipped(self) -> tuple[str, ...]:
        """Names of the photos whose annotated box reached beyond the photograph and was cut at its border."""
        return self._listing.clipped

    @cached_property
    def _listing(self) -> _Listing:
        listed: dict[str, dict[str, list[Photo]]] = {}
        left_out: list[LeftOut] = []
        clipped: list[str] = []
        seen: set[str] = set()
        found: set[str] = set()
        for split in SPLITS:
            for entry in self.animals(split):
                if isinstance(entry, LeftOut):
                    left_out.append(entry)
                    continue
                species = species_name(entry.species)
                found.add(species)
                if self.species is not None and species not in self.species:
                    continue
                if entry.name in seen:
                    raise FaunaError(
                        f"{self.root} expects different annotation names, got {entry.name} twice; mend the file"
                    )
                seen.add(entry.name)
                photo = self._photo(entry, species)
                if isinstance(photo, LeftOut):
                    left_out.append(photo)
                    continue
                clipped.extend([photo.name] if _reaches_out(entry) else [])
                listed.setdefault(species, {name: [] for name in SPLITS})[split].append(photo)
        self._check(listed, found, left_out)
        categories = {
            species: CategoryPhotos(species, **{s: tuple(sorted(p, key=_order)) for s, p in listed[species].items()})
            for species in sorted(listed)
        }
        return _Listing(categories, tuple((each.name, each.reason) for each in left_out), tuple(sorted(clipped)))

    def _photo(self, animal: Animal, species: str) -> Photo | LeftOut:
        """The photo of an animal, or why there is none."""
        names = self.raw_keypoint_names
        if animal.keypoints is not None and names is not None and len(animal.keypoints) != len(names):
            raise FaunaError(
                f"{animal.name} expects {len(names)} keypoints, one per name, got {len(animal.keypoints)}; mend the file"
            )
        annotated = sum(flag for *_, flag in animal.keypoints or ())
        if animal.mask is None and (animal.box is None or not annotated):
            return LeftOut(animal.name, "has neither a mask nor a box with annotated keypoints")
        if animal.mask is None and animal.size is not None and animal.box is not None:
            width, height = animal.size
            if clip_box(animal.box, height=height, width=width) is None:
                return LeftOut(animal.name, f"its box {animal.box} is empty or outside the {width}x{height} photograph")
        image = find_image(self.images, animal.image)
        if image is None:
            return LeftOut(animal.name, f"photograph {animal.image} is missing")
        box = None if animal.box is None else widen_box(animal.box, self.box_margin)
        source = CropSource(
            image=image, origin=animal.name, size=animal.size, box=box, mask=animal.mask,
            keypoints=animal.keypoints, crop_size=self.crop_size, box_fill=self.box_fill,
        )  # fmt: skip
        return Photo(animal.name, species, animal.photograph, source)

    def _check(self, listed: dict[str, dict[str, list[Photo]]], found: set[str], left_out: list[LeftOut]) -> None:
        unknown = sorted(set(self.species or ()) - found)
        if unknown:
            raise FaunaError(f"data.source.species: expected names among {', '.join(sorted(found))}, got {unknown}")
        if left_out and not listed:
            some = "; ".join(f"{each.name}: {each.reason}" for each in left_out[:3])
            raise FaunaError(
                f"{self.root} expects animals that can be used, with photographs in {self.images}, got none of "
                f"{len(left_out)} ({some}); check data.root and data.source.images"
            )
        if not listed:
            raise FaunaError(f"{self.root} expects annotated animals, got none; check data.source.annotations")


def species_name(text: str) -> str:
    """A species as folders and the command line name it.

    >>> species_name("King Cheetah ")
    'king_cheetah'
    >>> species_name("Кот")
    'кот'
    """
    return re.sub(r"[\W_]+", "_", unicodedata.normalize("NFC", text).casefold()).strip("_") or "animal"


def photograph_name(image: str, pattern: str | None, *, dataset: str) -> str:
    """What a file belongs to: the group of ``pattern`` where the whole name matches, else the file itself.

    >>> photograph_name("3cat/v10c1/frame1.jpg", r"(.+/v[0-9]+)c[0-9]+/[^/]+", dataset="apt36k")
    'apt36k/3cat/v10'
    """
    match = re.fullmatch(pattern, image) if pattern is not None else None
    return f"{dataset}/{forward_slashes(match[1] if match else image)}"


def _order(photo: Photo) -> tuple[str, str]:
    return photo.photograph, photo.name


def _reaches_out(animal: Animal) -> bool:
    if animal.mask is not None or animal.box is None or animal.size is None:
        return False
    width, height = animal.size
    return clip_box(animal.box, height=height, width=width) != animal.box
