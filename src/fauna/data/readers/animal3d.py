"""``data=animal3d``: images, masks and 2D keypoints of Animal3D. Its body model is not read.

Written from public descriptions of the format, without the data at hand: ``{"data": [{"img_path", "mask_path", "keypoint_2d", ...}]}``.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import Any

from fauna.data.readers.animal import Animal, LeftOut
from fauna.data.readers.collection import KeypointPhotos, photograph_name
from fauna.data.readers.files import entries, find_image, forward_slashes, keypoint_rows, read_json, require
from fauna.data.readers.masks import MaskFile
from fauna.errors import FaunaError

KEYS = ("img_path", "mask_path", "keypoint_2d")


class Animal3DPhotos(KeypointPhotos):
    """Animals of Animal3D.

    Args:
        root: dataset folder, with ``images`` and masks as the annotations name them.
        annotations: JSON file below the root with training photos, ``None`` = none.
        test_annotations: the same with test photos.
        images: folder below the root that image and mask paths start from.
        crop_size: side of a crop, pixels.
        species: the species to use, ``None`` = all.
        species_pattern: regular expression with one group; a photograph whose path matches it is of the species the group names.
        keypoint_names: the names in the order of the file, ``None`` = numbered. Public lists disagree about left and right.
        min_visibility: smallest flag of a keypoint that counts as annotated.
    """

    def __init__(
        self,
        *,
        root: str | None,
        annotations: str | None,
        test_annotations: str | None,
        images: str,
        crop_size: int,
        species: list[str] | None,
        species_pattern: str,
        keypoint_names: list[str] | None,
        min_visibility: float,
    ) -> None:
        super().__init__(root=root, images=images, crop_size=crop_size, box_margin=0.0, box_fill=1.0, species=species)
        given = {"train": annotations, "test": test_annotations}
        self.files = {split: file for split, file in given.items() if file is not None}
        if not self.files:
            raise FaunaError("data.source.annotations: expected a JSON file below data.root, got none; e.g. train.json")
        self.species_pattern = re.compile(species_pattern)
        self.given_names = None if keypoint_names is None else tuple(keypoint_names)
        self.min_visibility = min_visibility

    @property
    def sources(self) -> Sequence[str]:
        """The annotation files."""
        return [f"{split}={file}" for split, file in self.files.items()]

    def read_keypoint_names(self) -> tuple[str, ...] | None:
        """As given, else ``keypoint_00``, ``keypoint_01``, ..."""
        if self.given_names is not None:
            return self.given_names
        lists = (
            item.get("keypoint_2d") for each in self._contents.values() for item in each if isinstance(item, Mapping)
        )
        first = next((points for points in lists if isinstance(points, list)), None)
        return None if first is None else tuple(f"keypoint_{place:02d}" for place in range(len(first)))

    def animals(self, split: str) -> Iterator[Animal | LeftOut]:
        """In the order of the file."""
        for number, item in enumerate(self._contents.get(split, ())):
            read = partial(self._animal, item, self.files[split], number)
            yield self.entry(f"{self.files[split]}/entry {number}", read)

    def _animal(self, item: object, file: str, number: int) -> Animal | LeftOut:
        known = require(item, KEYS, f"{self.root / file} entry {number}")
        image = forward_slashes(str(known["img_path"]))
        name = f"{self.root.name}/{file}/{number:05d}"
        match = self.species_pattern.fullmatch(image)
        mask = find_image(self.images, forward_slashes(str(known["mask_path"])))
        if match is None:
            return LeftOut(name, f"{image} names no species; see data.source.species_pattern")
        if mask is None:
            return LeftOut(name, f"mask {known['mask_path']} is missing")
        return Animal(
            name=name,
            species=match[1],
            image=image,
            photograph=photograph_name(image, None, dataset=self.root.name),
            size=(int(known["width"]), int(known["height"])) if {"width", "height"} <= set(known) else None,
            box=None,
            mask=MaskFile(mask),
            keypoints=keypoint_rows(known["keypoint_2d"], name, shift=0.5, min_visibility=self.min_visibility),
        )

    @cached_property
    def _contents(self) -> dict[str, Sequence[Any]]:
        return {split: self._content(file) for split, file in self.files.items()}

    def _content(self, file: str) -> Sequence[Any]:
        where = str(self.root / file)
        return entries(require(read_json(self.root / file), ["data"], where)["data"], f"{where} data")
