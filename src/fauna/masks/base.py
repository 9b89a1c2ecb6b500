"""The interface of segmenters: what finds the animal in a photograph that comes without a mask."""

from abc import ABC, abstractmethod

import numpy as np
from jaxtyping import Bool, UInt8

AROUND = 0.2
"""Shares of a box's larger side that are shown on each side of it."""


class Segmenter(ABC):
    """Finds the animals of a photograph.

    Attributes:
        name: as the command line names it, and as ``result.json`` records it.
        flags: what a result should say about masks of this kind, of :data:`fauna.reconstruct.status.FLAGS`.
    """

    name: str
    flags: tuple[str, ...] = ()

    @abstractmethod
    def segment(self, image: UInt8[np.ndarray, "height width 3"]) -> Bool[np.ndarray, "height width"]:
        """The mask of all animals; empty where nothing stands out."""

    def segment_in(
        self, image: UInt8[np.ndarray, "height width 3"], box: tuple[float, float, float, float]
    ) -> Bool[np.ndarray, "height width"]:
        """The mask of the animal in a box; empty where nothing stands out.

        What surrounds the box is shown too, because a background must be seen to be told from an animal.

        Args:
            image: the whole photograph.
            box: left, top, right, bottom in its pixels; it may reach beyond it.
        """
        mask = np.zeros(image.shape[:2], bool)
        inner, outer = _window(box, mask.shape, 0.0), _window(box, mask.shape, AROUND)
        if mask[inner].size:
            mask[outer] = self.segment(image[outer])
            inside = np.zeros_like(mask)
            inside[inner] = True
            mask &= inside
        return mask


def _window(box: tuple[float, float, float, float], shape: tuple[int, ...], margin: float) -> tuple[slice, slice]:
    """Rows and columns of a box widened by ``margin`` of its larger side, as far as it is in the picture."""
    left, top, right, bottom = box
    extra = margin * max(right - left, bottom - top)
    rows = slice(max(int(top - extra), 0), max(min(int(np.ceil(bottom + extra)), shape[0]), 0))
    return rows, slice(max(int(left - extra), 0), max(min(int(np.ceil(right + extra)), shape[1]), 0))
