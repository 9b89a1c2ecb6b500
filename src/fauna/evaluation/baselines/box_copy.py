"""Keypoints keep their relative place in the mask's bounding box: what framing alone is worth."""

import numpy as np
from jaxtyping import Float

from fauna.evaluation.baselines.base import Bench, Transfer, TransferBaseline
from fauna.metrics.sample import Sample


class BoxCopy(TransferBaseline):
    """Needs masks only."""

    description = "Keypoints keep their relative place in the bounding box of the mask. No model."

    def prepare(self, bench: Bench) -> Transfer:
        """Boxes are computed once per sample."""
        boxes = {name: mask_box(sample) for name, sample in bench.samples.items()}

        def transfer(source: Sample, target: Sample) -> Float[np.ndarray, "key 2"]:
            (low, high), (low_target, high_target) = boxes[source.name], boxes[target.name]
            assert source.keypoints is not None
            relative = (source.keypoints[:, :2] - low) / np.maximum(high - low, 1e-6)
            return low_target + relative * (high_target - low_target)

        return transfer


def mask_box(sample: Sample) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """NDC of the mask's top left and bottom right corner; the whole picture without a mask."""
    if sample.mask is None or not sample.mask.any():
        return np.array([-1.0, -1.0]), np.array([1.0, 1.0])
    rows, columns = np.flatnonzero(sample.mask.any(axis=1)), np.flatnonzero(sample.mask.any(axis=0))
    low, high = np.array([columns[0], rows[0]], float), np.array([columns[-1] + 1, rows[-1] + 1], float)
    return low * 2.0 / sample.mask.shape[0] - 1.0, high * 2.0 / sample.mask.shape[0] - 1.0


BASELINE = BoxCopy()
