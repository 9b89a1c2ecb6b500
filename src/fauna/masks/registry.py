"""Which segmenters there are; those with weights are imported when they are asked for."""

from fauna.errors import FaunaError
from fauna.masks.base import Segmenter
from fauna.masks.grabcut import GrabCut

SEGMENTERS = ("grabcut", "sam", "rembg")


def build_segmenter(name: str, default: GrabCut) -> Segmenter:
    """The segmenter of a name.

    Args:
        name: ``grabcut``; ``sam`` or ``rembg``, with ``:MODEL`` for another than the usual weights.
        default: the one that needs no weights; ``sam`` is told by it where to look.

    Raises:
        FaunaError: for an unknown name, or when its package or weights are missing.
    """
    kind, _, weights = name.partition(":")
    if kind == "grabcut" and not weights:
        return default
    if kind == "sam":
        from fauna.masks.sam import USUAL, Sam

        return Sam(weights=weights or USUAL, guide=default)
    if kind == "rembg":
        from fauna.masks.rembg import USUAL, Rembg

        return Rembg(weights=weights or USUAL)
    raise FaunaError(f"segmenter: expected grabcut, sam[:MODEL] or rembg[:MODEL], got {name!r}; e.g. grabcut")
