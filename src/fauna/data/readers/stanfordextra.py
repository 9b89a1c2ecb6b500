"""``data=stanfordextra``: dogs with masks and 24 keypoints.

A JSON list of ``img_path``, ``img_width``, ``img_height``, ``img_bbox`` (x, y, width, height), ``joints`` (24, 3) and ``seg``, a compressed
run-length string. The splits are ``.npy`` files of indices into that list.
"""

from collections.abc import Iterator, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from fauna.data.readers.animal import Animal, LeftOut
from fauna.data.readers.collection import KeypointPhotos, photograph_name
from fauna.data.readers.files import box_of, entries, forward_slashes, keypoint_rows, read_json, require
from fauna.data.readers.keypoints import KEYPOINT_SETS
from fauna.data.readers.masks import parse_segmentation
from fauna.errors import FaunaError

KEYS = ("img_path", "img_width", "img_height", "img_bbox", "joints", "seg")


class StanfordExtraPhotos(KeypointPhotos):
    """Dogs of StanfordExtra on photographs of Stanford Dogs.

    Args:
        root: dataset folder.
        annotations: JSON file below the root.
        train_indices: ``.npy`` file of the training photos; ``None`` = all that are in no other split.
        val_indices: the same for validation, ``None`` = none.
        test_indices: the same for the test.
        images: folder below the root with one folder per breed.
        crop_size: side of a crop, pixels.
        min_visibility: smallest flag of a keypoint that counts as annotated.
    """

    def __init__(
        self,
        *,
        root: str | None,
        annotations: str,
        train_indices: str | None,
        val_indices: str | None,
        test_indices: str | None,
        images: str,
        crop_size: int,
        min_visibility: float,
    ) -> None:
        super().__init__(root=root, images=images, crop_size=crop_size, box_margin=0.0, box_fill=1.0, species=None)
        self.file = annotations
        self.index_files = {"train": train_indices, "val": val_indices, "test": test_indices}
        self.min_visibility = min_visibility

    @property
    def sources(self) -> Sequence[str]:
        """The annotation file and those of the splits."""
        return [self.file, *(f"{split}={file}" for split, file in self.index_files.items() if file is not None)]

    def read_keypoint_names(self) -> tuple[str, ...]:
        """The 24 of its table."""
        return KEYPOINT_SETS["stanfordextra"].names

    def animals(self, split: str) -> Iterator[Animal | LeftOut]:
        """In the order of the split's file."""
        for place in self._places[split]:
            yield self.entry(f"{self.file}/entry {place}", partial(self._animal, place))

    def _animal(self, place: int) -> Animal:
        item = require(self._items[place], KEYS, f"{self.root / self.file} entry {place}")
        name = f"{self.root.name}/{self.file}/{place:05d}"
        image = forward_slashes(str(item["img_path"]))
        width, height = int(item["img_width"]), int(item["img_height"])
        left, top, wide, high = box_of(item["img_bbox"], name)
        return Animal(
            name=name,
            species="dog",
            image=image,
            photograph=photograph_name(image, None, dataset=self.root.name),
            size=(width, height),
            box=(left, top, left + wide, top + high),
            mask=parse_segmentation(item["seg"], height, width),
            keypoints=keypoint_rows(item["joints"], name, shift=0.5, min_visibility=self.min_visibility),
        )

    @cached_property
    def _items(self) -> Sequence[Any]:
        return entries(read_json(self.root / self.file), str(self.root / self.file))

    @cached_property
    def _places(self) -> dict[str, list[int]]:
        given = {split: self._indices(file) for split, file in self.index_files.items() if file is not None}
        taken = {place for split in ("val", "test") for place in given.get(split, ())}
        rest = [place for place in range(len(self._items)) if place not in taken]
        return {"train": given.get("train", rest), "val": given.get("val", []), "test": given.get("test", [])}

    def _indices(self, file: str) -> list[int]:
        path = self.root / file
        try:
            places = np.load(path, allow_pickle=False).reshape(-1).astype(np.int64).tolist()
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise FaunaError(f"{path} expects a .npy file of indices, got {reason}; check data.source") from error
        if places and not 0 <= min(places) <= max(places) < len(self._items):
            raise FaunaError(
                f"{path} expects indices below {len(self._items)}, got {max(places)}; use files of one version"
            )
        return places
