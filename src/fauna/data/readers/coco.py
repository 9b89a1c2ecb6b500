"""``data=coco``: keypoint or instance annotations in COCO's JSON, and in the two JSON forms of Animal-Pose.

COCO: ``images`` (``id``, ``file_name``, ``width``, ``height``), ``annotations`` (``image_id``, ``category_id``, ``bbox`` as x, y, width,
height, ``keypoints``, ``segmentation``), ``categories`` (``id``, ``name``, ``keypoints``). Animal-Pose as published: ``images`` maps ids to
file names, and ``bbox`` is left, top, right, bottom. Lists with ``keypoint_names`` and ``items``: see :mod:`fauna.data.readers.items`.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property, partial
from typing import Any

from fauna.data.readers.animal import Animal, LeftOut
from fauna.data.readers.collection import KeypointPhotos, photograph_name
from fauna.data.readers.crop import Box
from fauna.data.readers.files import box_of, entries, forward_slashes, keypoint_rows, read_json, require
from fauna.data.readers.items import read_item
from fauna.data.readers.keypoints import KEYPOINT_SETS
from fauna.data.readers.masks import parse_segmentation
from fauna.errors import FaunaError


class CocoPhotos(KeypointPhotos):
    """Animals of COCO-like annotation files.

    Args:
        root: dataset folder.
        annotations: JSON file below the root whose photos are split by ``data.val_fraction`` and ``data.test_fraction``, or
            trained on when there are validation or test annotations; ``None`` = none.
        val_annotations: the same for validation photos.
        test_annotations: the same for test photos.
        images: folder of the photographs below the root.
        crop_size: side of a crop, pixels.
        box_margin: how far the box of an animal without mask is widened on each side, shares of its larger side.
        box_fill: share of that box that the animal is taken to cover.
        species: the species to use, ``None`` = all.
        species_field: field of an annotation that names the species, ``None`` = its category.
        keypoint_set: name in :data:`fauna.data.readers.keypoints.KEYPOINT_SETS`, for files whose categories list no keypoints.
        min_visibility: smallest flag of a keypoint that counts as annotated.
        photograph_pattern: regular expression with one group; a ``file_name`` that matches it is a frame of the video or a copy
            of the photograph the group names. ``None`` = every file is its own, unless images have a ``video_id``.
    """

    def __init__(
        self,
        *,
        root: str | None,
        annotations: str | None,
        val_annotations: str | None,
        test_annotations: str | None,
        images: str,
        crop_size: int,
        box_margin: float,
        box_fill: float,
        species: list[str] | None,
        species_field: str | None,
        keypoint_set: str | None,
        min_visibility: float,
        photograph_pattern: str | None,
    ) -> None:
        super().__init__(
            root=root, images=images, crop_size=crop_size, box_margin=box_margin, box_fill=box_fill, species=species
        )
        given = {"train": annotations, "val": val_annotations, "test": test_annotations}
        self.files = {split: file for split, file in given.items() if file is not None}
        if not self.files:
            raise FaunaError(
                "data.source.annotations: expected a JSON file below data.root, got none; give it, or val_ or test_annotations"
            )
        if keypoint_set is not None and keypoint_set not in KEYPOINT_SETS:
            raise FaunaError(
                f"data.source.keypoint_set: expected one of {', '.join(KEYPOINT_SETS)} or null, got {keypoint_set!r}"
            )
        self.species_field = species_field
        self.keypoint_set = keypoint_set
        self.min_visibility = min_visibility
        self.photograph_pattern = photograph_pattern

    @property
    def sources(self) -> Sequence[str]:
        """The annotation files."""
        return [f"{split}={file}" for split, file in self.files.items()]

    def read_keypoint_names(self) -> tuple[str, ...] | None:
        """From the categories or the items, else from the chosen set; ``None`` when nothing has keypoints."""
        lists = {names for content in self._contents.values() for names in _listed_names(content, str(self.root))}
        if len(lists) > 1:
            raise FaunaError(
                f"{self.root} expects one list of keypoint names, got {len(lists)} different ones; read the files separately"
            )
        if lists:
            return next(iter(lists))
        if self.keypoint_set is not None:
            return KEYPOINT_SETS[self.keypoint_set].names
        if any(_has_keypoints(content) for content in self._contents.values()):
            raise FaunaError(
                f"{self.root} expects keypoint names in its categories, got none; "
                f"choose data.source.keypoint_set among {', '.join(KEYPOINT_SETS)}"
            )
        return None

    def animals(self, split: str) -> Iterator[Animal | LeftOut]:
        """In the order of the file."""
        if split not in self.files:
            return
        file, content = self.files[split], self._contents[split]
        if "items" in content:
            listed = entries(content["items"], f"{self.root / file} items")
            for number, item in enumerate(listed):
                yield self.entry(f"{file}/entry {number}", partial(self._item, item, number, file))
            return
        where = str(self.root / file)
        images = _images(content["images"], where, self.skips_bad)
        categories = _by_id(content["categories"], f"{where} categories", ["id", "name"], self.skips_bad)
        for number, annotation in enumerate(entries(content["annotations"], f"{where} annotations")):
            yield self.entry(
                f"{file}/entry {number}", partial(self._annotated, annotation, number, file, where, images, categories)
            )

    def _item(self, item: object, number: int, file: str) -> Animal:
        return read_item(
            item, number, root=self.root, dataset=self.root.name, file=file, min_visibility=self.min_visibility
        )

    def _annotated(
        self, annotation: Any, number: int, file: str, where: str, images: Mapping, categories: Mapping
    ) -> Animal | LeftOut:
        require(annotation, ["image_id"], f"{where} annotation {number}")
        return self._animal(annotation, f"{file}/{annotation.get('id', number)}", images, categories)

    def statements(self, split: str) -> tuple[str | None, dict[str, str]]:
        """Where the photographs of a split's file come from, and the licence of each by its name in the file, where it says so."""
        content = self._contents[split]
        listed, info = content.get("images"), content.get("info")
        parts = [info.get(key) for key in ("description", "contributor", "url")] if isinstance(info, Mapping) else []
        origin = ", ".join(str(part).strip() for part in parts if part) or None
        known = content.get("licenses")
        licences = {
            str(each.get("id")): " ".join(str(each[key]) for key in ("name", "url") if each.get(key))
            for each in (known if isinstance(known, list) else ())
            if isinstance(each, Mapping)
        }
        named = (
            (forward_slashes(str(image.get("file_name"))), licences.get(str(image.get("license"))))
            for image in (listed if isinstance(listed, list) else ())
            if isinstance(image, Mapping)
        )
        return origin, {name: licence for name, licence in named if licence}

    def _animal(
        self, annotation: Mapping[str, Any], name: str, images: Mapping, categories: Mapping
    ) -> Animal | LeftOut:
        image = images.get(str(annotation["image_id"]))
        if image is None:
            return LeftOut(name, f"names image {annotation['image_id']}, which the file does not list")
        if annotation.get("iscrowd"):
            return LeftOut(name, "is a crowd, not one animal")
        if self.species_field is not None:
            species = annotation.get(self.species_field)
        else:
            species = categories.get(str(annotation.get("category_id")), {}).get("name")
        if species is None:
            missing = self.species_field or f"category {annotation.get('category_id')}"
            return LeftOut(name, f"names no species: {missing} is not in the file; see data.source.species_field")
        size = (int(image["width"]), int(image["height"])) if {"width", "height"} <= set(image) else None
        file_name = forward_slashes(image["file_name"])
        keypoints = annotation.get("keypoints")
        return Animal(
            name=f"{self.root.name}/{name}",
            species=str(species),
            image=file_name,
            photograph=self._photograph(image, file_name),
            size=size,
            box=_box(annotation.get("bbox"), image, name),
            mask=parse_segmentation(annotation.get("segmentation"), *((size or (0, 0))[::-1])),
            keypoints=None
            if not keypoints
            else keypoint_rows(keypoints, name, shift=0.5, min_visibility=self.min_visibility),
        )

    def _photograph(self, image: Mapping[str, Any], file_name: str) -> str:
        if self.photograph_pattern is None and "video_id" in image:
            return f"{self.root.name}/video-{image['video_id']}"
        return photograph_name(file_name, self.photograph_pattern, dataset=self.root.name)

    @cached_property
    def _contents(self) -> dict[str, Mapping[str, Any]]:
        return {split: self._content(file) for split, file in self.files.items()}

    def _content(self, file: str) -> Mapping[str, Any]:
        content = read_json(self.root / file)
        keys = (
            ["items"]
            if isinstance(content, Mapping) and "items" in content
            else ["images", "annotations", "categories"]
        )
        return require(content, keys, str(self.root / file))


def _images(listed: object, where: str, skips_bad: bool) -> dict[str, Mapping[str, Any]]:
    """Images by id; those of Animal-Pose's map of file names are marked, because its boxes are written differently."""
    if isinstance(listed, Mapping):
        return {str(key): {"file_name": str(name), "corners": True} for key, name in listed.items()}
    return _by_id(listed, f"{where} images", ["id", "file_name"], skips_bad)


def _by_id(listed: object, where: str, keys: Sequence[str], skips_bad: bool) -> dict[str, Mapping[str, Any]]:
    """Objects by id. Those without the keys end the reading, or are passed over: what names them is left out then."""
    numbered = enumerate(entries(listed, where))
    whole = (pair for pair in numbered if not skips_bad or (isinstance(pair[1], Mapping) and set(keys) <= set(pair[1])))
    found = [require(each, keys, f"{where} {number}") for number, each in whole]
    return {str(each["id"]): each for each in found}


def _box(values: object, image: Mapping[str, Any], name: str) -> Box | None:
    if values is None:
        return None
    left, top, third, fourth = box_of(values, name)
    return (left, top, third, fourth) if "corners" in image else (left, top, left + third, top + fourth)


def _listed_names(content: Mapping[str, Any], where: str) -> Iterator[tuple[str, ...]]:
    if "items" in content:
        listed = [content.get("keypoint_names") or []]
    else:
        categories = entries(content["categories"], f"{where} categories")
        listed = [each["keypoints"] for each in categories if isinstance(each, Mapping) and each.get("keypoints")]
    for names in listed:
        yield tuple(str(name).strip() for name in entries(names, f"{where} names of keypoints"))


def _has_keypoints(content: Mapping[str, Any]) -> bool:
    listed = content.get("annotations", ())
    return any(isinstance(each, Mapping) and each.get("keypoints") for each in listed)
