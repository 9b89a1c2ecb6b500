"""Annotation lists with one entry per animal: ``{"keypoint_names": [...], "items": [{...}, ...]}``.

An item has ``image`` and, optionally, ``mask`` (both files below the folder of the annotations), ``category``, ``keypoints``
[[x, y, visible], ...], ``bbox_xyxy``, ``width`` and ``height``; pixels are counted from 0.
"""

from pathlib import Path

from fauna.data.readers.animal import Animal
from fauna.data.readers.collection import photograph_name
from fauna.data.readers.files import box_of, keypoint_rows, require
from fauna.data.readers.masks import MaskFile


def read_item(item: object, number: int, *, root: Path, dataset: str, file: str, min_visibility: float) -> Animal:
    """An animal of such a list.

    Args:
        item: an entry.
        number: of the entry.
        root: folder that masks are named below.
        dataset: first part of the name.
        file: second part.
        min_visibility: smallest flag of a keypoint that counts as annotated.

    Raises:
        FaunaError: for an item without the keys above or with values that cannot be read.
    """
    known = require(item, ["image", "category"], f"{root / file} item {number}")
    name = f"{dataset}/{file}/{known.get('id', number)}"
    keypoints, box = known.get("keypoints"), known.get("bbox_xyxy")
    return Animal(
        name=name,
        species=str(known["category"]),
        image=str(known["image"]),
        photograph=photograph_name(str(known["image"]), None, dataset=dataset),
        size=(int(known["width"]), int(known["height"])) if {"width", "height"} <= set(known) else None,
        box=None if box is None else box_of(box, name),
        mask=MaskFile(root / str(known["mask"])) if known.get("mask") else None,
        keypoints=None if not keypoints else keypoint_rows(keypoints, name, shift=0.5, min_visibility=min_visibility),
    )
