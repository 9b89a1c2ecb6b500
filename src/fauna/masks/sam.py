"""Segment Anything (Kirillov et al., ICCV 2023) by way of transformers, prompted with a box."""

from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, UInt8

from fauna.errors import FaunaError
from fauna.masks.base import Segmenter

USUAL = "facebook/sam-vit-base"
MARGIN = 0.05
"""By which the box is larger than the guide's mask, extents."""


class Sam(Segmenter):
    """A model of the SAM family; the guide's mask says where to look.

    Args:
        weights: name on the Hugging Face hub, or a folder; anything that transformers loads for mask generation with boxes.
        guide: gives a rough mask.

    Raises:
        FaunaError: when the weights cannot be had, or are of another kind.
    """

    def __init__(self, *, weights: str, guide: Segmenter) -> None:
        from transformers import AutoModelForMaskGeneration, AutoProcessor

        try:
            self.processor: Any = AutoProcessor.from_pretrained(weights)
            self.network: Any = AutoModelForMaskGeneration.from_pretrained(weights).eval().requires_grad_(False)
        except (OSError, ValueError, KeyError, ImportError) as error:
            reason = " ".join(str(error).split())[:160]
            raise FaunaError(
                f"segmenter sam: expected weights of the SAM family, got {weights} ({reason}); give a folder with them as "
                "sam:FOLDER, or use grabcut"
            ) from error
        self.name = f"sam:{weights}"
        self.guide = guide

    def segment(self, image: UInt8[np.ndarray, "height width 3"]) -> Bool[np.ndarray, "height width"]:
        """The mask of highest predicted quality for a box around the guide's mask; empty where that is."""
        rough = self.guide.segment(image)
        return self.segment_in(image, _box(rough)) if rough.any() else rough

    @torch.no_grad()
    def segment_in(
        self, image: UInt8[np.ndarray, "height width 3"], box: tuple[float, float, float, float]
    ) -> Bool[np.ndarray, "height width"]:
        """The mask of highest predicted quality for a box."""
        inputs = self.processor(images=image, input_boxes=[[list(box)]], return_tensors="pt")
        outputs = self.network(**inputs, multimask_output=True)
        sizes = (inputs["original_sizes"], inputs["reshaped_input_sizes"]) if "reshaped_input_sizes" in inputs else (
            inputs["original_sizes"],
        )  # fmt: skip
        masks = self.processor.post_process_masks(outputs.pred_masks, *sizes)[0]  # (box, candidate, height, width)
        best = int(outputs.iou_scores.reshape(-1).argmax())
        return masks.reshape(-1, *image.shape[:2])[best].numpy().astype(bool)


def _box(mask: Bool[np.ndarray, "height width"]) -> tuple[float, float, float, float]:
    """Left, top, right, bottom of a mask with a margin."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    extra = MARGIN * max(np.ptp(rows) + 1, np.ptp(columns) + 1)
    return (
        max(float(columns[0] - extra), 0.0),
        max(float(rows[0] - extra), 0.0),
        min(float(columns[-1] + 1 + extra), float(mask.shape[1])),
        min(float(rows[-1] + 1 + extra), float(mask.shape[0])),
    )
