"""Small datasets in the published formats, written by us: two animals on one photograph, one on another, frames of a video."""

import json
from pathlib import Path

import numpy as np
from PIL import Image

from fauna.data.readers.coco import CocoPhotos

WIDTH, HEIGHT = 60, 40
ANIMALS = ((8, 10, 28, 22), (35, 15, 55, 35))  # left, top, right, bottom of an ellipse each, whole pixels
NAMES = ("left_eye", "right_eye", "tail")


def ellipse(box: tuple[int, int, int, int]) -> np.ndarray:
    left, top, right, bottom = box
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    inside = ((2 * x - left - right) / (right - left)) ** 2 + ((2 * y - top - bottom) / (bottom - top)) ** 2
    return inside <= 1


def photograph(path: Path, *, marks: list[tuple[int, int]] | None = None) -> None:
    """Both animals in grey on blue; ``marks`` are single white pixels."""
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    pixels[..., 2] = 200
    for box in ANIMALS:
        pixels[ellipse(box)] = 120
    for x, y in marks or ():
        pixels[y, x] = 255
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path)


def keypoints_of(box: tuple[int, int, int, int]) -> list[list[float]]:
    """An eye at each end, and a tail that nobody saw."""
    left, top, right, bottom = box
    middle = (top + bottom) // 2
    return [[left + 2, middle, 2], [right - 2, middle, 1], [0, 0, 0]]


def annotation(number: int, image: int, box: tuple[int, int, int, int], **more: object) -> dict:
    left, top, right, bottom = box
    flat = [value for point in keypoints_of(box) for value in point]
    return {
        "id": number, "image_id": image, "category_id": 7, "bbox": [left, top, right - left, bottom - top],
        "keypoints": flat, "num_keypoints": 2, "iscrowd": 0, **more,
    }  # fmt: skip


def coco_content(**changes: object) -> dict:
    images = [
        {"id": number, "file_name": name, "width": WIDTH, "height": HEIGHT}
        for number, name in ((1, "one.png"), (2, "two.png"))
    ]
    annotations = [annotation(12, 2, ANIMALS[0]), annotation(10, 1, ANIMALS[0]), annotation(11, 1, ANIMALS[1])]
    category = {"id": 7, "name": "Argali Sheep", "keypoints": list(NAMES)}
    return {"images": images, "annotations": annotations, "categories": [category], **changes}


def coco_folder(folder: Path, **changes: object) -> Path:
    for name in ("one.png", "two.png"):
        photograph(folder / "photos" / name)
    (folder / "coco.json").write_text(json.dumps(coco_content(**changes)))
    return folder


def coco(folder: Path, **changes: object) -> CocoPhotos:
    given = {
        "root": str(folder), "annotations": "coco.json", "val_annotations": None, "test_annotations": None, "images": "photos",
        "crop_size": 32, "box_margin": 0.0, "box_fill": 0.5, "species": None, "species_field": None, "keypoint_set": None,
        "min_visibility": 1.0, "photograph_pattern": None,
    }  # fmt: skip
    return CocoPhotos(**{**given, **changes})


def compress(counts: list[int]) -> str:
    """COCO's compressed string, the slow and obvious way: five bits a character, differences from the fourth run on."""
    text = ""
    for place, count in enumerate(counts):
        value = count - counts[place - 2] if place > 2 else count
        while True:
            bits, value = value % 32, value // 32  # floor division keeps the sign
            last = (value == 0 and bits < 16) or (value == -1 and bits >= 16)
            text += chr(48 + bits + (0 if last else 32))
            if last:
                break
    return text


def runs(mask: np.ndarray) -> list[int]:
    """Run lengths down the columns, one pixel after the other, background first."""
    found, value = [0], False
    for column in range(mask.shape[1]):
        for row in range(mask.shape[0]):
            if bool(mask[row, column]) != value:
                found.append(0)
                value = not value
            found[-1] += 1
    return found
