"""Background removal by the package rembg, an optional extra; it fetches its weights when they are first used."""

from typing import Any

import numpy as np
from jaxtyping import Bool, UInt8

from fauna.errors import FaunaError
from fauna.masks.base import Segmenter

USUAL = "isnet-general-use"


class Rembg(Segmenter):
    """A salient-object network; takes whatever is in front, animal or not.

    Args:
        weights: one of rembg's models.

    Raises:
        FaunaError: when the package is missing, or has no such model, or its weights cannot be had.
    """

    def __init__(self, *, weights: str) -> None:
        try:
            import rembg  # pyright: ignore[reportMissingImports]  # an optional extra
        except ImportError as error:
            raise FaunaError(
                "segmenter rembg: expected the package rembg, got none; pip install -e '.[rembg]' in the checkout, or use grabcut"
            ) from error
        try:
            self.session: Any = rembg.new_session(weights)
        except Exception as error:  # of its downloader, its runtime or its list of models
            reason = " ".join(f"{type(error).__name__} {error}".split())[:160]
            raise FaunaError(
                f"segmenter rembg: expected one of its models with weights, got {weights} ({reason}); check the name and "
                "the network, or use grabcut"
            ) from error
        self.name = f"rembg:{weights}"
        self._remove: Any = rembg.remove

    def segment(self, image: UInt8[np.ndarray, "height width 3"]) -> Bool[np.ndarray, "height width"]:
        """Pixels that are more likely in front than behind."""
        return np.asarray(self._remove(image, session=self.session, only_mask=True)) > 127
