"""The fitted map: an exact solution is found, the constraints hold, nothing beats it."""

import numpy as np
import pytest

from fauna.metrics.keypoint_map import apply_map, clip_positions, fit_map, in_fit_half, reference_places, resample
from fauna.metrics.visibility import to_ndc
from tests.metrics.animals import herd


def scene(images=30, points=25, seed=0):
    """Predictions, random positions in their worlds, and their homogeneous images."""
    predictions, _ = herd(images, seed=seed)
    positions = np.random.default_rng(seed).normal(0, 0.7, (images, points, 3))
    return predictions, positions, clip_positions(predictions, positions)


def annotate(predictions, points):
    return np.stack(
        [
            np.column_stack([to_ndc(p.clip_from_world, x), np.ones(len(x))])
            for p, x in zip(predictions, points, strict=True)
        ]
    )


def test_an_exact_mixture_is_found_through_the_perspective():
    predictions, positions, clip = scene()
    truth = np.zeros((2, 25))
    truth[0, [3, 8, 20]] = 0.5, 0.3, 0.2
    truth[1, 7] = 1.0
    found = fit_map(clip, annotate(predictions, apply_map(truth, positions)))
    np.testing.assert_allclose(found, truth, atol=1e-6)


def test_weights_are_a_mixture_and_cannot_be_improved():
    predictions, positions, clip = scene(images=6)
    keypoints = annotate(predictions, positions[:, :3])
    keypoints[..., :2] += np.random.default_rng(5).normal(0, 0.1, keypoints[..., :2].shape)
    keypoints[2, 1, 2] = 0
    weights = fit_map(clip, keypoints)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    depth = clip[..., 3].mean(axis=1)

    def loss(row, key):
        total = 0.0
        for i in range(len(clip)):
            if keypoints[i, key, 2]:
                mixed = row @ clip[i]
                total += (((mixed[:2] - keypoints[i, key, :2] * mixed[3]) / depth[i]) ** 2).sum()
        return total

    rng = np.random.default_rng(0)
    for key in range(3):
        for _ in range(100):
            other = np.abs(weights[key] + 0.02 * rng.normal(size=25) * (rng.random(25) < 0.2))
            assert loss(other / other.sum(), key) >= loss(weights[key], key) - 1e-9


def test_a_keypoint_never_seen_has_no_weights():
    predictions, positions, clip = scene(images=3)
    keypoints = annotate(predictions, positions[:, :2])
    keypoints[:, 1, 2] = 0
    weights = fit_map(clip, keypoints)
    assert np.isfinite(weights[0]).all()
    assert np.isnan(weights[1]).all()


@pytest.mark.parametrize("count", [1, 2, 9, 10])
def test_halves_are_a_function_of_seed_and_names(count):
    names = [f"n{i}" for i in range(count)]
    half = in_fit_half(names, seed=0)
    assert half.sum() == (count + 1) // 2
    again = in_fit_half(names[::-1], seed=0)
    np.testing.assert_array_equal(half, again[::-1])
    if count == 10:
        assert len({tuple(in_fit_half(names, seed=s)) for s in range(5)}) > 1


def test_reference_is_spread_and_resampling_finds_it_again():
    predictions, _ = herd(3)
    places = reference_places(predictions[0], count=40)
    gaps = np.linalg.norm(places.general[:, None] - places.general[None], axis=2) + 10 * np.eye(40)
    assert gaps.min() > 0.15
    own = resample(predictions[:1], places)[0]
    away = np.linalg.norm(own[:, None] - predictions[0].verts[None], axis=2).min(axis=1)
    np.testing.assert_allclose(away, 0, atol=1e-9)
    assert resample(predictions, places).shape == (3, 40, 3)
