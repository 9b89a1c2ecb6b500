"""The segmenter that needs no weights: GrabCut, seeded by what stands out in the encoder's features."""

import threading

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import binary_fill_holes

from fauna.encoder.base import Encoder
from fauna.masks.animals import connected
from fauna.masks.base import Segmenter
from fauna.masks.options import GrabCutOptions, SaliencyOptions
from fauna.masks.saliency import saliency

_LOCK = threading.Lock()
"""GrabCut draws from OpenCV's one random state."""
_MODEL = (1, 65)
"""Shape of its colour models."""


class GrabCut(Segmenter):
    """GrabCut (Rother et al., SIGGRAPH 2004, in OpenCV) from seeds by :func:`fauna.masks.saliency.saliency`.

    Args:
        encoder: frozen.
        saliency: how cells are rated.
        options: how ratings become a mask.
    """

    name = "grabcut"
    flags = ("mask_from_saliency",)

    def __init__(self, *, encoder: Encoder, saliency: SaliencyOptions, options: GrabCutOptions) -> None:
        self.encoder = encoder
        self.saliency = saliency
        self.options = options

    def segment(self, image: UInt8[np.ndarray, "height width 3"]) -> Bool[np.ndarray, "height width"]:
        """The mask; the same picture gives the same mask."""
        mask = self._look(image)
        if not self.options.look_closer or not mask.any():
            return mask
        rows, columns = _window(mask, self.options.look_closer)
        if (rows.stop - rows.start) * (columns.stop - columns.start) < self.options.closer_share * mask.size:
            closer = self._look(image[rows, columns])
            if closer.any():
                mask = np.zeros_like(mask)
                mask[rows, columns] = closer
        return mask

    def _look(self, image: UInt8[np.ndarray, "height width 3"]) -> Bool[np.ndarray, "height width"]:
        height, width = image.shape[:2]
        scale = self.options.side / max(height, width)
        size = (max(round(width * scale), 8), max(round(height * scale), 8))
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        rating = saliency(self.encoder, image, self.saliency)
        over = cv2.resize(rating, size, interpolation=cv2.INTER_CUBIC)
        over -= np.quantile(over, 1.0 - self.options.animal_share)
        cut = self._cut(small, over)
        mask = best_parts(np.asarray(binary_fill_holes(cut)), over, self.options.part_share)
        if mask.mean() > self.options.largest_share:
            mask[:] = False
        enlarged = cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
        return enlarged > 0.5

    def _cut(
        self, image: UInt8[np.ndarray, "height width 3"], over: Float[np.ndarray, "height width"]
    ) -> Bool[np.ndarray, "height width"]:
        """GrabCut; ``over`` is the rating above the threshold between animal and background."""
        labels = np.full(over.shape, cv2.GC_PR_BGD, np.uint8)
        labels[over > 0] = cv2.GC_PR_FGD
        labels[over > self.options.sure_animal] = cv2.GC_FGD
        labels[over < -self.options.sure_background] = cv2.GC_BGD
        if not (over > 0).any() or not (over <= 0).any() or np.ptp(image) == 0:
            return np.zeros(over.shape, bool)
        with _LOCK:
            cv2.setRNGSeed(0)
            bgr, models = image[..., ::-1].copy(), (np.zeros(_MODEL), np.zeros(_MODEL))
            try:
                cv2.grabCut(bgr, labels, (0, 0, 1, 1), *models, self.options.iterations, cv2.GC_INIT_WITH_MASK)
            except cv2.error:  # fewer colours than the models have parts
                return np.zeros(over.shape, bool)
        return (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)


def best_parts(
    mask: Bool[np.ndarray, "height width"], over: Float[np.ndarray, "height width"], share: float
) -> Bool[np.ndarray, "height width"]:
    """The connected part with the largest sum of positive ratings, and others of at least ``share`` of its area."""
    labels, count = connected(mask)
    if count == 0:
        return mask
    areas = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    sums = np.bincount(labels.ravel(), weights=over.clip(min=0.0).ravel(), minlength=count + 1)[1:]
    kept = areas >= share * areas[sums.argmax()]
    kept[sums.argmax()] = True
    return np.concatenate([[False], kept])[labels]


def _window(mask: Bool[np.ndarray, "height width"], extents: float) -> tuple[slice, slice]:
    """Rows and columns of a window around a mask, as far as it is in the picture."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    half = 0.5 * extents * max(np.ptp(rows) + 1, np.ptp(columns) + 1)
    middle = 0.5 * (rows[0] + rows[-1] + 1), 0.5 * (columns[0] + columns[-1] + 1)
    return tuple(  # type: ignore[return-value]
        slice(max(int(at - half), 0), min(int(np.ceil(at + half)), limit))
        for at, limit in zip(middle, mask.shape, strict=True)
    )
