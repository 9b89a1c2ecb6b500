"""Sources with annotation files, by way of the readers of :mod:`fauna.data.readers`."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fauna.data.fauna_folder import SPLITS
from fauna.data.readers.animal import Animal, LeftOut
from fauna.data.readers.coco import CocoPhotos
from fauna.data.readers.collection import KeypointPhotos
from fauna.data.readers.crop import Box, widen_box
from fauna.data.readers.files import find_image
from fauna.data.readers.masks import Mask, MaskFile
from fauna.errors import FaunaError
from fauna.prepare.masks_given import ONE, text_of_mask
from fauna.prepare.record import Point, Record, Rows
from fauna.prepare.sources.base import Source
from fauna.prepare.sources.naming import FARTHEST, Naming
from fauna.prepare.workspace import text_of_path


@dataclass(frozen=True)
class AnnotatedSource(Source):
    """Photographs that an annotation file names.

    All entries are held in memory, as they are in the file. A photograph's animals are numbered in the order of the file.

    Attributes:
        kind: as ``source.kind`` names it.
        reader: of the file.
        images: folder of the photographs.
        naming: of the rows.
        box_margin: by which annotated boxes are widened, shares of the larger side.
        keypoint_names: of the reader, canonical.
    """

    kind: str
    reader: KeypointPhotos
    images: Path
    naming: Naming
    box_margin: float
    keypoint_names: tuple[str, ...] | None

    def photos(self) -> Iterator[Rows]:
        """Photographs in the order in which the file first names them; then what cannot be used."""
        animals: dict[str, list[Animal]] = {}
        unusable: list[LeftOut] = []
        origins: dict[str, str | None] = {}
        licences: dict[str, str] = {}
        for split in SPLITS:
            entries = list(self.reader.animals(split))
            stated = self.reader.statements(split) if entries and isinstance(self.reader, CocoPhotos) else (None, {})
            licences.update(stated[1])
            for entry in entries:
                told = entry if isinstance(entry, LeftOut) else self._fault(entry)
                if told is not None:
                    unusable.append(told)
                    continue
                assert isinstance(entry, Animal)
                animals.setdefault(entry.image, []).append(entry)
                origins[entry.image] = stated[0]
        seen: dict[Path, str] = {}
        missing: list[tuple[str, Animal]] = []
        for image, found in animals.items():
            path = find_image(self.images, image)
            if path is None:
                missing.append((image, found[0]))
            elif path in seen:  # two names of one file
                unusable += [LeftOut(each.name, f"{image} is the file of {seen[path]}") for each in found]
            else:
                seen[path] = image
                yield self._rows(path, found, licences.get(image), origins[image])
        yield from ((self._missing(*each),) for each in missing)
        yield from self._left_out(unusable)

    def _fault(self, animal: Animal) -> LeftOut | None:
        """What is wrong with an annotation by itself."""
        names = self.keypoint_names
        if animal.keypoints is not None and names is not None and len(animal.keypoints) != len(names):
            return LeftOut(animal.name, f"has {len(animal.keypoints)} keypoints for {len(names)} names")
        places = [*(animal.box or ()), *(side for point in animal.keypoints or () for side in point[:2])]
        if any(abs(place) > FARTHEST for place in places):
            return LeftOut(animal.name, "has a box or keypoint farther away than any photograph reaches")
        if animal.size is not None and max(map(abs, animal.size)) > FARTHEST:
            return LeftOut(animal.name, f"says that its photograph has {animal.size[0]:g} x {animal.size[1]:g} pixels")
        if animal.box is not None and animal.mask is None and not _has_area(animal.box):
            return LeftOut(animal.name, f"its box {animal.box} is empty")
        if isinstance(animal.mask, MaskFile):
            try:
                self.naming.text(animal.mask.path)
            except FaunaError:
                return LeftOut(animal.name, f"its mask {animal.mask.path} is outside of the source")
        return None

    def _left_out(self, entries: Sequence[LeftOut]) -> Iterator[Rows]:
        """A row each; entries of one name, which files may have, are told apart."""
        names: Counter[str] = Counter()
        for entry in entries:
            names[entry.name] += 1
            again = f" ({names[entry.name]})" if names[entry.name] > 1 else ""
            yield (self.naming.unusable(f"{entry.name}{again}", entry.reason, "annotation"),)

    def _rows(self, path: Path, animals: Sequence[Animal], licence: str | None, provenance: str | None) -> Rows:
        return tuple(
            self.naming.row(
                path,
                animal.species,
                instance=number,
                group=None if animal.photograph.endswith(animal.image) else text_of_path(Path(animal.photograph)),
                licence=licence,
                provenance=provenance,
                origin=text_of_path(Path(animal.name)),
                annotated_size=animal.size,
                box=widen_box(animal.box, self.box_margin) if animal.box and _has_area(animal.box) else None,
                given_mask=None if animal.mask is None else self._mask_text(animal.mask),
                keypoints=animal.keypoints,
            )
            for number, animal in enumerate(animals)
        )

    def _mask_text(self, mask: Mask) -> str:
        if isinstance(mask, MaskFile):
            return f"{ONE}:{self.naming.text(mask.path)}"
        return text_of_mask(mask)

    def _missing(self, image: str, animal: Animal) -> Record:
        reason = f"photograph {image} is missing"
        return self.naming.unusable(f"{animal.name}:{image}", reason, "missing", animal.species)


@dataclass(frozen=True)
class SeveralSources(Source):
    """Several annotation files below one folder, with their keypoints in one order.

    Attributes:
        kind: of all files, ``several`` where they differ.
        keypoint_names: every name that any file has, in the order of the files.
        sources: of the files.
    """

    kind: str
    keypoint_names: tuple[str, ...] | None
    sources: tuple[AnnotatedSource, ...]

    def photos(self) -> Iterator[Rows]:
        """File by file; what is named twice is used once."""
        names = self.keypoint_names or ()
        places = {name: place for place, name in enumerate(names)}
        seen: set[str] = set()
        for source in self.sources:
            for rows in source.photos():
                if rows[0].photo in seen:
                    continue
                seen.add(rows[0].photo)
                yield tuple(
                    replace(row, keypoints=_placed(row.keypoints, source.keypoint_names or (), places)) for row in rows
                )


def _has_area(box: Box) -> bool:
    left, top, right, bottom = box
    return left < right and top < bottom


def joined(sources: Sequence[AnnotatedSource]) -> Source:
    """One source of several annotation files; a single one is itself."""
    if len(sources) == 1:
        return sources[0]
    kinds = sorted({source.kind for source in sources})
    names = dict.fromkeys(name for source in sources for name in source.keypoint_names or ())
    return SeveralSources(kinds[0] if len(kinds) == 1 else "several", tuple(names) or None, tuple(sources))


def _placed(
    points: tuple[Point, ...] | None, names: Sequence[str], places: Mapping[str, int]
) -> tuple[Point, ...] | None:
    """Keypoints in the order of all names; (0, 0, 0) where the file has no such keypoint."""
    if points is None:
        return None
    placed = [(0.0, 0.0, 0.0)] * len(places)
    for name, point in zip(names, points, strict=True):
        placed[places[name]] = point
    return tuple(placed)
