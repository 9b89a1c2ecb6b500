"""What a reader finds in an annotation file."""

from dataclasses import dataclass

from fauna.data.readers.crop import Box
from fauna.data.readers.masks import Mask


@dataclass(frozen=True)
class Animal:
    """One annotated animal, as a reader finds it.

    Attributes:
        name: unique within its annotation file.
        species: as annotated.
        image: photograph below the folder of photographs, with forward slashes.
        photograph: what must stay in one split; usually ``image``.
        size: (width, height) of the photograph, ``None`` when the annotation does not say.
        box: left, top, right, bottom in pixels of the photograph; ``None`` when not annotated.
        mask: ``None`` when not annotated.
        keypoints: (x, y, 1 where annotated) in pixels of the photograph; ``None`` when not annotated.
    """

    name: str
    species: str
    image: str
    photograph: str
    size: tuple[int, int] | None
    box: Box | None
    mask: Mask | None
    keypoints: tuple[tuple[float, float, float], ...] | None


@dataclass(frozen=True)
class LeftOut:
    """An annotation that cannot be used.

    Attributes:
        name: of the annotation.
        reason: why, in words.
    """

    name: str
    reason: str
