"""What the published COCO-like sets need beyond the format, and how each is recognised by its file."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Any

from fauna.data.readers.keypoints import KEYPOINT_SETS


@dataclass(frozen=True)
class Profile:
    """Options of :class:`fauna.data.readers.coco.CocoPhotos`, see docs/data.md.

    Attributes:
        name: of the data set.
        keypoint_set: for files that name no keypoints.
        species_field: field of an annotation that names the species.
        photograph_pattern: what makes files frames of one video.
        box_margin: by which boxes that only hold the keypoints are widened, shares of the larger side.
    """

    name: str
    keypoint_set: str | None = None
    species_field: str | None = None
    photograph_pattern: str | None = None
    box_margin: float = 0.0


COCO = Profile("coco")
PROFILES: dict[str, Profile] = {
    each.name: each
    for each in (
        COCO,
        Profile("animalpose", keypoint_set="animalpose"),
        Profile("ap10k", keypoint_set="ap10k"),
        Profile("apt36k", keypoint_set="ap10k", photograph_pattern=r"(?:.*/)?([^/]+/v\d+)[cC]\d+/[^/]+"),
        Profile("animal_kingdom", species_field="animal", photograph_pattern=r"(.+)/[^/]+", box_margin=0.15),
        Profile("horse10", photograph_pattern=r"(.+)/[^/]+", box_margin=0.15),
        Profile("zebra", box_margin=0.15),
        Profile("atrw"),
    )
}


def recognise(content: Mapping[str, Any]) -> Profile:
    """The profile of a COCO-like file; :data:`COCO` for one of no published set."""
    if isinstance(content.get("images"), Mapping):  # Animal-Pose as published: file names by id
        return PROFILES["animalpose"]
    first = next(_objects(content, "annotations"), {})
    if {"animal", "animal_parent_class"} <= set(first):
        return PROFILES["animal_kingdom"]
    names = next((sorted(str(name).strip() for name in each["keypoints"]) for each in _objects(content, "categories") if isinstance(each.get("keypoints"), list) and each["keypoints"]), None)  # fmt: skip
    if names is None:
        count = len(first.get("keypoints") or ()) // 3
        return {17: PROFILES["ap10k"], 20: PROFILES["animalpose"]}.get(count, COCO)
    for name in ("horse10", "zebra", "atrw", "animalpose"):
        if names == sorted(KEYPOINT_SETS[name].names):
            return PROFILES[name]
    if names == sorted(KEYPOINT_SETS["ap10k"].names):
        files = [str(each.get("file_name", "")).replace("\\", "/") for each in islice(_objects(content, "images"), 50)]
        clips = any(re.search(r"/v\d+c\d+/", name, re.IGNORECASE) for name in files)
        return PROFILES["apt36k" if clips else "ap10k"]
    return COCO


def _objects(content: Mapping[str, Any], key: str) -> Iterator[Mapping[str, Any]]:
    listed = content.get(key)
    return (each for each in (listed if isinstance(listed, list) else ()) if isinstance(each, Mapping))
