"""Annotated masks as one line of text in a row, and back to pixels of the photograph at working size.

``file:PATH`` is a picture of one animal; ``objects:PATH`` a picture with a colour for each animal, whatever stands before it;
``labels:PATH`` a picture of any number of animals (a colour each, or parts that do not touch);
``rle:{...}`` and ``polygons:[...]`` are COCO's. Paths are texts of :meth:`fauna.prepare.workspace.Workspace.photo`.
"""

import json
from pathlib import Path

import numpy as np
from PIL import Image

from fauna.data.readers.masks import Mask, Polygons, Rle
from fauna.errors import FaunaError
from fauna.prepare.frames import Size, drawn_upright, stored_size
from fauna.prepare.workspace import Workspace
from fauna.reconstruct.mask_files import FoundMasks, array_masks, read_masks
from fauna.reconstruct.photograph import Photograph
from fauna.reconstruct.pixels import oriented
from fauna.reconstruct.settings import MaskSettings
from fauna.reconstruct.status import Refused

ONE, OBJECTS, ANY = "file", "objects", "labels"


def text_of_mask(mask: Rle | Polygons) -> str:
    """The line of a mask that its annotation file holds.

    >>> text_of_mask(Rle(2, 2, (1, 3)))
    'rle:{"size":[2,2],"counts":[1,3]}'
    """
    if isinstance(mask, Rle):
        counts = mask.counts if isinstance(mask.counts, str) else list(mask.counts)
        return "rle:" + _json({"size": [mask.height, mask.width], "counts": counts})
    return "polygons:" + _json([list(ring) for ring in mask.rings])


def holds_one(text: str) -> bool:
    """Whether the mask is of one animal, however many parts and colours it has."""
    return not text.startswith((f"{ANY}:", f"{OBJECTS}:"))


def has_parts(text: str) -> bool:
    """Whether parts of the mask that do not touch may be different animals."""
    return text.startswith(f"{ANY}:")


def given_file(text: str, workspace: Workspace) -> Path | None:
    """The picture file of a mask, ``None`` for masks that annotations hold."""
    kind, _, rest = text.partition(":")
    return workspace.photo(rest) if kind in (ONE, OBJECTS, ANY) else None


def read_given(
    text: str, photograph: Photograph, workspace: Workspace, limits: MaskSettings, *, annotated: Size | None = None
) -> FoundMasks:
    """The masks of a line.

    Args:
        text: the line.
        photograph: whose mask it is.
        workspace: where paths begin.
        limits: of mask files.
        annotated: size of the photograph according to the annotation: tells on which picture outlines were drawn.

    Raises:
        Refused: ``bad_mask``, for a file that is no picture, or a mask of something else.
    """
    path = given_file(text, workspace)
    if path is not None:
        return read_masks([path], photograph, "given", limits)
    kind, _, rest = text.partition(":")
    try:
        values = json.loads(rest)
        stored = stored_size(photograph.size, photograph.orientation)
        if kind == "rle":
            height, width = values["size"]
            counts = values["counts"]
            mask: Mask = Rle(height, width, counts if isinstance(counts, str) else tuple(counts))
            if (width, height) not in (
                photograph.size,
                stored,
            ):  # told before it is unrolled, however large it claims to be
                raise ValueError(f"one of {width}x{height} for {stored[0]}x{stored[1]}")
        else:
            mask = Polygons(tuple(tuple(ring) for ring in values))
            width, height = photograph.size if annotated == photograph.size else stored
        return array_masks([_upright(mask.decode(height, width), photograph)], photograph)
    except Refused:
        raise
    except (FaunaError, ArithmeticError, LookupError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())[:120]
        raise Refused(
            "bad_mask", f"{photograph.name}: expected an annotated mask, got {reason}; mend the annotation"
        ) from error


def _upright(mask: np.ndarray, photograph: Photograph) -> np.ndarray:
    """A mask drawn on the stored picture, turned with the photograph; one of the upright size is taken as it is."""
    if drawn_upright(mask.shape[::-1], photograph.size, photograph.orientation):
        return mask
    picture = Image.fromarray(mask.astype(np.uint8) * np.uint8(255))
    return np.array(oriented(picture, photograph.orientation)) > 0


def _json(value: object) -> str:
    return json.dumps(value, separators=(",", ":"))
