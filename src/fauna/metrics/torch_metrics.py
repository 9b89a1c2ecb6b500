"""The same numbers accumulated over batches, for training loops (torchmetrics)."""

import torch
from jaxtyping import Float
from torch import Tensor
from torchmetrics import Metric

from fauna.errors import FaunaError
from fauna.metrics.iou import silhouette_iou
from fauna.metrics.transfer import NDC_PER_CROP, THRESHOLD


class SilhouetteIoU(Metric):
    """Mean over images of :func:`fauna.metrics.iou.silhouette_iou`."""

    total: Tensor
    count: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.add_state("total", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("count", torch.zeros((), dtype=torch.int64), dist_reduce_fx="sum")

    def update(self, silhouette: Float[Tensor, "row height width"], mask: Float[Tensor, "row height width"]) -> None:
        """Add images with values in [0, 1]."""
        self.total += silhouette_iou(silhouette, mask).double().sum()
        self.count += len(mask)

    def compute(self) -> Float[Tensor, ""]:
        """The mean.

        Raises:
            FaunaError: without images.
        """
        if not self.count:
            raise FaunaError("SilhouetteIoU: expected at least one image, got none; call update first")
        return self.total / self.count


class CorrectKeypoints(Metric):
    """PCK@0.1 as :func:`fauna.metrics.transfer.judge` has it: per keypoint the share within a tenth of the crop, then their mean.

    Args:
        num_keypoints: of the dataset.
    """

    correct: Tensor
    counted: Tensor

    def __init__(self, *, num_keypoints: int) -> None:
        super().__init__()
        self.add_state("correct", torch.zeros(num_keypoints, dtype=torch.int64), dist_reduce_fx="sum")
        self.add_state("counted", torch.zeros(num_keypoints, dtype=torch.int64), dist_reduce_fx="sum")

    def update(self, predicted: Float[Tensor, "row key 2"], keypoints: Float[Tensor, "row key 3"]) -> None:
        """Add images.

        Args:
            predicted: NDC; NaN is a miss.
            keypoints: NDC x, y and 1 where annotated.
        """
        counted = keypoints[..., 2] > 0
        near = (predicted - keypoints[..., :2]).norm(dim=-1) <= THRESHOLD * NDC_PER_CROP
        self.correct += (near & counted).sum(dim=0)
        self.counted += counted.sum(dim=0)

    def compute(self) -> Float[Tensor, ""]:
        """Mean over the keypoints seen so far.

        Raises:
            FaunaError: no keypoint was annotated.
        """
        seen = self.counted > 0
        if not seen.any():
            raise FaunaError(
                "CorrectKeypoints: expected an annotated keypoint, got none; call update with keypoints first"
            )
        return (self.correct[seen].double() / self.counted[seen]).mean()
