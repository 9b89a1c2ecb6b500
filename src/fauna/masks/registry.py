"""Which segmenters there are; each is imported when it is asked for."""

from fauna.encoder.base import Encoder
from fauna.errors import FaunaError
from fauna.masks.base import Segmenter

SEGMENTERS = ("grabcut", "sam", "rembg")


def build_segmenter(name: str, encoder: Encoder) -> Segmenter:
    """The segmenter of a name.

    Args:
        name: ``grabcut``; ``sam`` or ``rembg``, with ``:MODEL`` for another than the usual weights.
        encoder: whose features tell where an animal might be.

    Raises:
        FaunaError: for an unknown name, or when its package or weights are missing.
    """
    kind, _, model = name.partition(":")
    if kind == "grabcut" and not model:
        from fauna.masks.grabcut import GrabCut

        return GrabCut(encoder=encoder)
    if kind == "sam":
        from fauna.masks.sam import Sam

        return Sam(encoder=encoder, weights=model or Sam.DEFAULT)
    if kind == "rembg":
        from fauna.masks.rembg import Rembg

        return Rembg(weights=model or Rembg.DEFAULT)
    raise FaunaError(f"segmenter: expected grabcut, sam[:MODEL] or rembg[:MODEL], got {name!r}; e.g. grabcut")
