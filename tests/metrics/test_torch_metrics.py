"""The accumulating classes equal the pure functions, whatever the batches."""

import pickle

import numpy as np
import pytest
import torch

from fauna.errors import FaunaError
from fauna.metrics.iou import silhouette_iou
from fauna.metrics.tally import Tally, estimates
from fauna.metrics.torch_metrics import CorrectKeypoints, SilhouetteIoU
from fauna.metrics.transfer import judge


@pytest.mark.parametrize("batch", [1, 3, 7])
def test_silhouette_iou_over_batches(batch):
    generator = torch.Generator().manual_seed(0)
    first, second = torch.rand(7, 5, 5, generator=generator), torch.rand(7, 5, 5, generator=generator)
    metric = SilhouetteIoU()
    for start in range(0, 7, batch):
        metric.update(first[start : start + batch], second[start : start + batch])
    expected = silhouette_iou(first, second).double().mean()
    torch.testing.assert_close(pickle.loads(pickle.dumps(metric)).compute(), expected)


@pytest.mark.parametrize("batch", [1, 4, 10])
def test_correct_keypoints_over_batches(batch):
    rng = np.random.default_rng(0)
    keypoints = np.concatenate([rng.uniform(-1, 1, (10, 4, 2)), rng.random((10, 4, 1)) < 0.6], axis=2)
    keypoints[:, 3, 2] = 0
    predicted = keypoints[..., :2] + rng.normal(0, 0.15, (10, 4, 2))
    predicted[0, 0] = np.nan
    pairs = np.stack([np.arange(10), np.arange(10)], axis=1)
    counted, correct, _ = judge(predicted, keypoints, pairs, np.arange(4))
    expected = estimates(Tally(pairs, correct * 1.0, counted * 1.0, tuple("abcd")), np.ones((1, 10)))[0]
    metric = CorrectKeypoints(num_keypoints=4)
    for start in range(0, 10, batch):
        rows = slice(start, start + batch)
        metric.update(torch.from_numpy(predicted[rows]), torch.from_numpy(keypoints[rows]))
    assert 0.2 < expected < 0.9
    assert metric.compute().item() == pytest.approx(expected)


@pytest.mark.filterwarnings("ignore:The ``compute`` method")
def test_nothing_to_average_is_an_error():
    with pytest.raises(FaunaError, match="expected at least one image, got none"):
        SilhouetteIoU().compute()
    with pytest.raises(FaunaError, match="expected an annotated keypoint, got none"):
        CorrectKeypoints(num_keypoints=3).compute()
