"""A zero-shot detector (OWL-ViT, Grounding DINO, ...) by way of transformers: a box for each animal of a named species."""

from typing import Any

import numpy as np
import torch
from jaxtyping import UInt8

from fauna.errors import FaunaError
from fauna.masks.boxes import Box, overlap

SAME = 0.7
"""IoU from which two boxes are one animal."""


class Detector:
    """Finds animals by the name of their species.

    Args:
        weights: name on the Hugging Face hub, or a folder; anything that transformers loads for zero-shot object detection.
        score: least confidence, in [0, 1].

    Raises:
        FaunaError: when the weights cannot be had, or are of another kind.
    """

    def __init__(self, *, weights: str, score: float) -> None:
        from transformers import AutoModelForZeroShotObjectDetection, AutoProcessor

        try:
            self.processor: Any = AutoProcessor.from_pretrained(weights)
            self.network: Any = (
                AutoModelForZeroShotObjectDetection.from_pretrained(weights).eval().requires_grad_(False)
            )
        except (OSError, ValueError, KeyError, ImportError) as error:
            reason = " ".join(str(error).split())[:160]
            raise FaunaError(
                f"detector: expected weights of a zero-shot object detector, got {weights} ({reason}); give a folder with them, "
                "or null"
            ) from error
        self.name = f"detector:{weights}"
        self.score = score

    @torch.no_grad()
    def boxes(self, image: UInt8[np.ndarray, "height width 3"], species: str) -> list[Box]:
        """Left, top, right, bottom of each animal in pixels, surest first; of boxes that nearly agree the surest.

        Args:
            image: the photograph.
            species: its name, words joined by ``_``.
        """
        words = f"a {species.replace('_', ' ')}."
        inputs = self.processor(text=[[words]], images=[image], return_tensors="pt")
        outputs = self.network(**inputs)
        found = self.processor.post_process_grounded_object_detection(
            outputs, threshold=self.score, target_sizes=[image.shape[:2]]
        )[0]
        order = found["scores"].argsort(descending=True, stable=True)
        kept: list[Box] = []
        for left, top, right, bottom in found["boxes"][order].tolist():
            box = (left, top, right, bottom)
            if right > left and bottom > top and all(overlap(box, other) < SAME for other in kept):
                kept.append(box)
        return kept
