"""Annotation lists with one entry per animal: ``{"keypoint_names": [...], "items": [{...}, ...]}``.

An item has ``image`` and, optionally, ``mask`` (both files below the folder of the annotations), ``category``, ``keypoints``
[[x, y, visible], ...], ``bbox_xyxy``, ``width`` and ``height``; pixels are counted from 0.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from fauna.data.readers.animal import Animal
from fauna.data.readers.collection import photograph_name
from fauna.data.readers.files import box_of, entries, keypoint_rows, require
from fauna.data.readers.masks import MaskFile


def read_items(
    content: Mapping[str, Any], *, root: Path, dataset: str, file: str, min_visibility: float
) -> Iterator[Animal]:
    """Animals of such a list, in its order.

    Args:
        content: of the file.
        root: folder that masks are named below.
        dataset: first part of the names.
        file: second part.
        min_visibility: smallest flag of a keypoint that counts as annotated.

    Raises:
        FaunaError: for an item without the keys above or with values that cannot be read.
    """
    for number, item in enumerate(entries(content["items"], f"{root / file} items")):
        name = f"{dataset}/{file}/{item.get('id', number) if isinstance(item, Mapping) else number}"
        require(item, ["image", "category"], f"{root / file} item {number}")
        keypoints, box = item.get("keypoints"), item.get("bbox_xyxy")
        yield Animal(
            name=name,
            species=str(item["category"]),
            image=str(item["image"]),
            photograph=photograph_name(str(item["image"]), None, dataset=dataset),
            size=(int(item["width"]), int(item["height"])) if {"width", "height"} <= set(item) else None,
            box=None if box is None else box_of(box, name),
            mask=MaskFile(root / str(item["mask"])) if item.get("mask") else None,
            keypoints=None
            if not keypoints
            else keypoint_rows(keypoints, name, shift=0.5, min_visibility=min_visibility),
        )
