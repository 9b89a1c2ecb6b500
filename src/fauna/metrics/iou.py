"""Silhouette intersection over union."""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fauna.errors import FaunaError
from fauna.metrics.outcome import Options, Outcome, per_image
from fauna.metrics.sample import Case


@torch.no_grad()
def silhouette_iou(
    silhouette: Float[Tensor, "row height width"], mask: Float[Tensor, "row height width"]
) -> Float[Tensor, " row"]:
    """IoU of the images thresholded at one half; 1 where both are empty.

    >>> silhouette_iou(torch.ones(1, 2, 2), torch.tensor([[[1.0, 1.0], [0.0, 0.0]]])).item()
    0.5
    """
    first, second = silhouette > 0.5, mask > 0.5
    union = (first | second).sum(dim=(1, 2))
    both = (first & second).sum(dim=(1, 2))
    return torch.where(union == 0, 1.0, both / union.clamp_min(1))


def iou_metric(cases: Sequence[Case], options: Options) -> Outcome:
    """``iou``: of the predicted silhouette and the mask. Needs no mesh: an empty silhouette counts, with 0.

    Raises:
        FaunaError: silhouette and mask differ in size.
    """
    return per_image(cases, ("iou",), _measure)


def _measure(case: Case) -> dict[str, float | str]:
    mask, prediction = case.sample.mask, case.prediction
    if mask is None or prediction is None:
        return {"iou": "no mask" if mask is None else "no prediction"}
    if mask.shape != prediction.silhouette.shape:
        raise FaunaError(
            f"expected a mask of {prediction.silhouette.shape[0]} pixels for {case.sample.name} as its silhouette, "
            f"got {mask.shape[0]}; load the dataset at the model's image size"
        )
    silhouette = torch.from_numpy(prediction.silhouette.astype(np.float32) / 255)[None]
    return {"iou": float(silhouette_iou(silhouette, torch.from_numpy(mask).float()[None])[0])}
