"""From a photograph to the masks of its animals."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool
from PIL import Image

from fauna.errors import FaunaError
from fauna.masks.animals import extent, split_animals
from fauna.masks.base import Segmenter
from fauna.reconstruct.mask_files import FoundMasks, alpha_mask, array_masks, masks_beside, read_masks
from fauna.reconstruct.photograph import Photograph
from fauna.reconstruct.settings import MaskSettings
from fauna.reconstruct.status import Refused

MaskInput = str | Path | Image.Image | np.ndarray


def find_masks(
    photograph: Photograph, given: Sequence[MaskInput] | None, segmenter: Segmenter, limits: MaskSettings
) -> FoundMasks:
    """In this order: given ones, files beside the photograph, the alpha channel, the segmenter's.

    Args:
        photograph: upright.
        given: picture files, or arrays or pictures of the photograph's size.
        segmenter: asked last.
        limits: what counts.

    Raises:
        FaunaError: for files and arrays at once, or what is neither.
        Refused: when a mask is no picture, or none of this photograph.
    """
    if given is not None:
        if (
            not isinstance(given, Sequence)
            or isinstance(given, str)
            or not all(isinstance(each, MaskInput) for each in given)
        ):
            kinds = (
                sorted({type(each).__name__ for each in given})
                if isinstance(given, list | tuple)
                else [type(given).__name__]
            )
            raise FaunaError(
                f"masks: expected files, PIL pictures or numpy arrays, got {', '.join(kinds)}; convert it, or leave it out"
            )
        files = [Path(each).expanduser() for each in given if isinstance(each, str | Path)]
        arrays = [
            np.array(each.convert("L")) if isinstance(each, Image.Image) else each
            for each in given
            if not isinstance(each, str | Path)
        ]
        if files and arrays:
            raise FaunaError("masks: expected files or arrays, got both; give one kind")
        return array_masks(arrays, photograph) if arrays else read_masks(files, photograph, "given", limits)
    beside = masks_beside(photograph.path) if photograph.path is not None else []
    if beside:
        return read_masks(beside, photograph, "beside", limits)
    flags: tuple[str, ...] = ()
    if photograph.alpha is not None:
        found = alpha_mask(photograph, limits)
        if found is not None:
            return found
        flags = ("alpha_ignored",)
    mask = segmenter.segment(photograph.image)
    digest = hashlib.sha256(mask.tobytes()).hexdigest()
    return FoundMasks((mask,), "segmenter", digest, (*flags, *segmenter.flags))


def find_animals(
    photograph: Photograph, found: FoundMasks, limits: MaskSettings
) -> tuple[list[Bool[np.ndarray, "height width"]], tuple[str, ...]]:
    """Each animal's mask, largest first, and flags.

    Args:
        photograph: upright.
        found: its masks.
        limits: what counts.

    Raises:
        Refused: when there is no animal, or none that is large enough.
    """
    parts = {"animal_share": limits.animal_share, "speck_share": limits.speck_share, "same_gap": limits.same_gap}
    animals = [animal for mask in found.masks for animal in split_animals(mask, **parts)]
    if not animals:
        what = "nothing that stands out" if found.source == "segmenter" else "an empty mask"
        raise Refused("no_animal", f"{photograph.name}: expected an animal, got {what}; give a mask of the animal")
    animals.sort(key=lambda animal: -int(animal.sum()))
    large = [animal for animal in animals if extent(animal) * photograph.scale >= limits.min_extent]
    if not large:
        raise Refused(
            "too_small",
            f"{photograph.name}: expected an animal of at least {limits.min_extent} pixels, got "
            f"{extent(animals[0]) * photograph.scale:.0f}; use a larger photograph",
        )
    flags = ("several_animals",) if len(large) > 1 else ()
    return large[: limits.max_animals], flags + (("more_animals",) if len(large) > limits.max_animals else ())
