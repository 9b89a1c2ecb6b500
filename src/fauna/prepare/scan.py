"""The first look at every photograph: can it be read, what is in the file, what does it look like."""

import contextlib
import json
import warnings
from dataclasses import replace
from pathlib import Path

import imagehash
import numpy as np
from jaxtyping import UInt8
from PIL import ExifTags, Image

from fauna.prepare.frames import drawn_upright, stored_size, turned_box, turned_point
from fauna.prepare.overrides import read_overrides
from fauna.prepare.pictures import open_photograph
from fauna.prepare.record import Record, Rows
from fauna.prepare.settings import Settings, digest
from fauna.prepare.steps import Step
from fauna.prepare.workspace import Workspace
from fauna.reconstruct.formats import OPENED
from fauna.reconstruct.photograph import Photograph
from fauna.reconstruct.status import Refused

VERSION = 2
"""Part of the step's key, to be raised with what it does."""

KEPT_TAGS = ("Make", "Model", "Artist", "Copyright", "DateTime", "DateTimeOriginal")
"""EXIF tags that go into the manifest; places and serial numbers do not."""

LONGEST_TAG = 200
FLAT = 1.0
"""Grey levels of spread below which a picture is too even to be compared with others."""


class ScanStep(Step):
    """Digest, perceptual hash, size and EXIF of a photograph; refuses what cannot be read.

    Boxes and keypoints that were annotated on the stored picture are turned with it (:mod:`fauna.prepare.frames`).

    Args:
        settings: of the command.
        workspace: the folders.
    """

    name = "scan"

    def __init__(self, *, settings: Settings, workspace: Workspace) -> None:
        self.settings, self.workspace = settings, workspace
        path = settings.overrides
        self.overrides = read_overrides(None if path is None else Path(path))
        self._key = digest(VERSION, settings.photo)

    @property
    def key(self) -> str:
        """Limits of reading."""
        return self._key

    def stamp(self, rows: Rows) -> str:
        """Size and time of last change of the file, and the verdicts on its animals."""
        said = self.overrides.about(rows[0])
        with contextlib.suppress(OSError, ValueError):  # no file has a null byte in its name
            found = self.workspace.photo(rows[0].source).stat()
            return f"{found.st_size}:{found.st_mtime_ns}{said}"
        return f"absent{said}"

    def outputs(self, rows: Rows) -> list[Path]:
        """A scan writes no files."""
        return []

    def __call__(self, rows: Rows) -> Rows:
        """The rows with the facts of their file."""
        rows = tuple(replace(row, override=self.overrides.of(row)) for row in rows)
        path = self.workspace.photo(rows[0].source)
        try:
            photograph = open_photograph(rows[0], self.settings, self.workspace)
        except Refused as refusal:
            reason = refusal.status if _exists(path) else "missing"
            return tuple(row.rejected(self.name, reason) if row.ok else row for row in rows)
        facts = {
            "sha256": photograph.sha256,
            "phash": perceptual_hash(photograph.image),
            "format": photograph.format,
            "width": photograph.size[0],
            "height": photograph.size[1],
            "orientation": photograph.orientation,
            "exif": read_exif(path),
        }
        return tuple(self._scanned(replace(row, **facts), photograph) if row.ok else row for row in rows)

    def _scanned(self, row: Record, photograph: Photograph) -> Record:
        row = row.with_notes(*photograph.flags)
        size, orientation = photograph.size, photograph.orientation
        if row.annotated_size not in (None, size, stored_size(size, orientation)):
            return row.rejected(self.name, "size_differs")
        if drawn_upright(row.annotated_size, size, orientation):
            return row
        points = row.keypoints
        return replace(
            row,
            box=None if row.box is None else turned_box(row.box, size, orientation),
            keypoints=None if points is None else tuple(turned_point(each, size, orientation) for each in points),
        )


def perceptual_hash(image: UInt8[np.ndarray, "height width 3"]) -> str | None:
    """64 bits of the lowest frequencies (``imagehash.phash``) as 16 hexadecimal digits, ``None`` for an even picture.

    Args:
        image: upright, 8-bit RGB.
    """
    grey = Image.fromarray(image).convert("L").resize((32, 32), Image.Resampling.BOX)
    if float(np.asarray(grey).std()) < FLAT:
        return None
    return str(imagehash.phash(grey))


def read_exif(path: Path) -> str | None:
    """JSON of :data:`KEPT_TAGS` as far as a file has them, ``None`` without any or when they are damaged."""
    found: dict[str, str] = {}
    with contextlib.suppress(Exception), warnings.catch_warnings():  # damaged notes raise anything
        warnings.simplefilter("ignore")
        with Image.open(path, formats=OPENED) as picture:
            exif = picture.getexif()
            for number, value in {**exif, **exif.get_ifd(ExifTags.IFD.Exif)}.items():
                name = ExifTags.TAGS.get(number)
                if name in KEPT_TAGS and isinstance(value, str) and (text := _printable(value)):
                    found[name] = text
    return json.dumps(found, sort_keys=True) if found else None


def _printable(text: str) -> str:
    return "".join(letter for letter in text if letter.isprintable()).strip()[:LONGEST_TAG]


def _exists(path: Path) -> bool:
    with contextlib.suppress(OSError):
        return path.is_file()
    return True  # a folder that may not be read: the file is there for all we know
