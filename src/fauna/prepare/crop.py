"""The crop step: a square around each animal by the rule shared with reconstruction, and the files beside it."""

import hashlib
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image

from fauna.data.crop_rules import ruled_window
from fauna.data.cut import cut
from fauna.prepare.masks_stored import read_mask
from fauna.prepare.pictures import open_photograph
from fauna.prepare.record import Point, Record, Rows
from fauna.prepare.settings import Settings, digest
from fauna.prepare.steps import Step
from fauna.prepare.workspace import Workspace, file_digest, write_file
from fauna.reconstruct.photograph import Photograph
from fauna.reconstruct.status import Refused

VERSION = 1


class CropStep(Step):
    """Cuts the crops.

    The photograph is reduced to ``photo.work_side`` before, as in reconstruction; places in rows and in the box file are pixels of
    the photograph at full size all the same.

    Args:
        settings: group ``crop``.
        workspace: where crops go.
    """

    name = "crop"

    def __init__(self, *, settings: Settings, workspace: Workspace) -> None:
        self.settings = settings
        self.workspace = workspace

    @property
    def key(self) -> str:
        """Of the settings and what a photograph is."""
        return digest(VERSION, self.settings.crop, self.settings.photo)

    def __call__(self, rows: Rows) -> Rows:
        """The rows with windows and digests."""
        first = next((row for row in rows if row.ok), None)
        if first is None:
            return rows
        try:
            photograph = open_photograph(first, self.settings, self.workspace)
        except Refused as refusal:
            return tuple(row.rejected(self.name, refusal.status) if row.ok else row for row in rows)
        picture = Image.fromarray(photograph.image)
        return tuple(self._cropped(row, photograph, picture) if row.ok else row for row in rows)

    def outputs(self, rows: Rows) -> list[Path]:
        """Crop, mask and box of rows that are ok; keypoints where the source has some."""
        ends = ("rgb.jpg", "mask.png", "box.txt")
        files = [self.workspace.crop(row.id, end) for row in rows if row.ok for end in ends]
        return files + [
            self.workspace.crop(row.id, "keypoints.json") for row in rows if row.ok and row.keypoints is not None
        ]

    def intact(self, rows: Rows) -> bool:
        """Whether every file has the bytes that were made: a file in DEST is the same one by a link, and may have been written over."""
        return super().intact(rows) and all(self._as_made(row) for row in rows if row.ok)

    def _as_made(self, row: Record) -> bool:
        for end, text in texts_of(row, self.settings.crop.size).items():
            if self.workspace.crop(row.id, end).read_bytes() != text:
                return False
        made = {"rgb.jpg": row.rgb_sha256, "mask.png": row.mask_sha256}
        return all(file_digest(self.workspace.crop(row.id, end)) == digest for end, digest in made.items())

    def _cropped(self, row: Record, photograph: Photograph, picture: Image.Image) -> Record:
        mask = read_mask(self.workspace.mask(row.id))
        window = ruled_window(mask, self.settings.crop.rule)
        image, small, _ = cut(picture, mask, window, self.settings.crop.size)
        left, top, side = (float(value) * photograph.scale for value in window)
        row = replace(row, window=(left, top, side))
        if not small.any():
            return row.rejected(self.name, "too_small")
        rgb, drawn = encode_rgb(image, self.settings.crop.jpeg_quality), encode_small_mask(small)
        write_file(self.workspace.crop(row.id, "rgb.jpg"), rgb)
        write_file(self.workspace.crop(row.id, "mask.png"), drawn)
        for end, text in texts_of(row, self.settings.crop.size).items():
            write_file(self.workspace.crop(row.id, end), text)
        if row.keypoints is not None and not any(flag for *_, flag in row.keypoints):
            row = row.with_notes("no_keypoint_annotated")
        return replace(row, rgb_sha256=_sha256(rgb), mask_sha256=_sha256(drawn))


def crop_keypoints(points: tuple[Point, ...], window: tuple[float, float, float], size: int) -> list[list[float]]:
    """Keypoints in crop pixels, 0 is the left or top edge; zeros where not annotated.

    Args:
        points: (x, y, annotated) in pixels of the photograph.
        window: left, top and side of the crop, likewise.
        size: side of the crop, its own pixels.

    >>> crop_keypoints(((30.0, 25.0, 1.0), (3.0, 4.0, 0.0)), (10.0, 5.0, 40.0), 80)
    [[40.0, 40.0, 1.0], [0.0, 0.0, 0.0]]
    """
    left, top, side = window
    scale = size / side
    return [
        [round((x - left) * scale, 3), round((y - top) * scale, 3), 1.0] if flag else [0.0, 0.0, 0.0]
        for x, y, flag in points
    ]


def texts_of(row: Record, size: int) -> dict[str, bytes]:
    """The small files of a crop by their ends, which follow from its row.

    Args:
        row: with its window.
        size: side of the crop, its own pixels.
    """
    assert row.window is not None
    texts = {"box.txt": box_line(row).encode()}
    if row.keypoints is not None:
        points = crop_keypoints(row.keypoints, row.window, size)
        texts["keypoints.json"] = json.dumps({"keypoints": points}, separators=(",", ":")).encode()
    return texts


def box_line(row: Record) -> str:
    """The line of a box file, ``frame x0 y0 w h photo_w photo_h sharpness``, in pixels of the photograph at full size."""
    assert row.window is not None
    left, top, side = row.window
    return f"{row.frame or 0} {left:.2f} {top:.2f} {side:.2f} {side:.2f} {row.width} {row.height} 0.00\n"


def encode_rgb(image: UInt8[np.ndarray, "side side 3"], quality: int) -> bytes:
    """A crop as JPEG."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "JPEG", quality=quality)
    return buffer.getvalue()


def encode_small_mask(mask: Bool[np.ndarray, "side side"]) -> bytes:
    """A crop's mask as an 8-bit PNG of 0 and 255."""
    buffer = io.BytesIO()
    Image.fromarray(mask.astype(np.uint8) * np.uint8(255)).save(buffer, "PNG", optimize=False)
    return buffer.getvalue()


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
