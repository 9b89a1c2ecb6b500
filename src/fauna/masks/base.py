"""The interface of segmenters: what finds the animal in a photograph that comes without a mask."""

from abc import ABC, abstractmethod

import numpy as np
from jaxtyping import Bool, UInt8


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
