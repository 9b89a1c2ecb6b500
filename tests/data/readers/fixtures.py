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


def animal3d_folder(folder: Path) -> Path:
    """Two training photos and a test photo, with masks as pictures of zeros and ones."""
    for split, count in (("train", 2), ("test", 1)):
        items = []
        for number in range(count):
            name = f"{split}/n0/n0_{number}_zebra.png"
            photograph(folder / "images" / name)
            mask = folder / "masks" / name
            mask.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(ellipse(ANIMALS[number]).astype(np.uint8)).save(mask)
            items.append(
                {
                    "img_path": f"images/{name}", "mask_path": f"masks/{name}", "width": WIDTH, "height": HEIGHT,
                    "keypoint_2d": keypoints_of(ANIMALS[number]), "bbox": [0, 0, 1, 1], "pose": [0.0], "shape": [0.0],
                }
            )  # fmt: skip
        (folder / f"{split}.json").write_text(json.dumps({"data": items}))
    return folder


def pascal_folder(
    folder: Path, *, mirror: tuple[int, ...] = (2, 1, 3), species: tuple[str, ...] = ("horse", "cow")
) -> Path:
    """Two animals per species on one photograph; pixels and indices count from 1."""
    from scipy.io import savemat

    data = folder / "data"
    data.mkdir(parents=True)
    photograph(folder / "JPEGImages" / "2008_000001.png")
    fields = [(name, object) for name in ("rel_path", "voc_rec_id", "bbox", "parts", "mask")]
    for name in species:
        images = np.zeros((1, len(ANIMALS)), dtype=fields)
        for number, box in enumerate(ANIMALS):
            left, top, right, bottom = box
            parts = np.array(keypoints_of(box), float).T + [[1.0], [1.0], [0.0]]
            corners = {"x1": left + 1.0, "y1": top + 1.0, "x2": float(right), "y2": float(bottom)}
            images[0, number] = ("2008_000001.png", number + 1, corners, parts, ellipse(box).astype(np.uint8))
        savemat(data / f"{name}_val.mat", {"images": images})
        savemat(
            data / f"{name}_kps.mat",
            {"kp_names": np.array(["L_Eye", "R_Eye", "TailBase"], object), "kp_perm_inds": np.array(mirror)},
        )
    return folder


def stanfordextra_folder(folder: Path, *, dogs: int = 4) -> Path:
    """Dogs on photographs of their own, compressed masks, 24 joints."""
    items = []
    for number in range(dogs):
        name = f"n0-breed/n0_{number}.png"
        photograph(folder / "Images" / name)
        left, top, right, bottom = box = ANIMALS[number % 2]
        joints = keypoints_of(box) * 8
        items.append(
            {
                "img_path": name, "img_width": WIDTH, "img_height": HEIGHT, "is_multiple_dogs": False, "joints": joints,
                "img_bbox": [left, top, right - left, bottom - top], "seg": compress(runs(ellipse(box))),
            }
        )  # fmt: skip
    (folder / "StanfordExtra_v12.json").write_text(json.dumps(items))
    np.save(folder / "test.npy", np.array([2]))
    return folder
