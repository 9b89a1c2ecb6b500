"""Keypoint transfer against a loop over pairs and keypoints."""

from dataclasses import replace

import numpy as np
import pytest

from fauna.errors import FaunaError
from fauna.metrics.lookup import SurfaceIndex, vertex_places
from fauna.metrics.pairs import mirror_map, ordered_pairs
from fauna.metrics.transfer import judge, transfer_by_function, transfer_canonical, transfer_shared_base
from fauna.metrics.visibility import keypoint_vertices, to_ndc, visible_vertices
from tests.metrics.animals import NAMES, animal, herd


def points_of(samples):
    return [np.where(s.keypoints[:, 2:] > 0, s.keypoints, 0.0) for s in samples]


def noisy(samples, seed=0, scale=0.15):
    rng = np.random.default_rng(seed)
    return [p + np.column_stack([rng.normal(0, scale, (len(p), 2)), np.zeros(len(p))]) for p in points_of(samples)]


def slow_transfer(predictions, keypoints, pairs):
    out = np.full((len(pairs), len(NAMES), 2), np.nan)
    for row, (s, t) in enumerate(pairs):
        seen = visible_vertices(predictions[s])
        ndc = to_ndc(predictions[s].clip_from_world, predictions[s].verts)
        for key in range(len(NAMES)):
            if not keypoints[s][key, 2]:
                continue
            away = [np.hypot(*(ndc[v] - keypoints[s][key, :2])) if seen[v] else np.inf for v in range(len(ndc))]
            place = vertex_places(predictions[s]).rows(np.array([int(np.argmin(away))]))
            corners, weights = SurfaceIndex.of(predictions[t]).find(place)
            point = (predictions[t].verts[corners] * weights[..., None]).sum(axis=1)
            out[row, key] = to_ndc(predictions[t].clip_from_world, point)[0]
    return out


def slow_judge(predicted, keypoints, pairs, mirror):
    counted, plain, free = (np.zeros(predicted.shape[:2], bool) for _ in range(3))
    for row, (s, t) in enumerate(pairs):
        own, other = np.zeros(len(mirror), bool), np.zeros(len(mirror), bool)
        for k, m in enumerate(mirror):
            if keypoints[s][k, 2] and keypoints[t][k, 2]:
                counted[row, k] = True
                own[k] = np.hypot(*(predicted[row, k] - keypoints[t][k, :2])) / 2 <= 0.1
                other[k] = keypoints[t][m, 2] and np.hypot(*(predicted[row, k] - keypoints[t][m, :2])) / 2 <= 0.1
        plain[row] = own
        free[row] = other if other.sum() > own.sum() else own
    return counted, plain, free


def test_vectorised_transfer_equals_a_loop():
    predictions, samples = herd(4)
    keypoints, pairs = noisy(samples), ordered_pairs([s.name for s in samples], count=8, seed=1)
    found = transfer_canonical(predictions, keypoints, pairs)
    np.testing.assert_allclose(found, slow_transfer(predictions, keypoints, pairs), atol=1e-12)


def test_judgement_equals_a_loop():
    rng = np.random.default_rng(0)
    mirror, pairs = mirror_map(NAMES), ordered_pairs(list("abcdef"), count=30, seed=0)
    keypoints = np.concatenate([rng.uniform(-0.5, 0.5, (6, len(NAMES), 2)), rng.random((6, len(NAMES), 1)) < 0.7], 2)
    predicted = np.where(
        rng.random((30, 1, 1)) < 0.5, keypoints[pairs[:, 1]][..., :2], keypoints[pairs[:, 1]][:, mirror, :2]
    )
    predicted = predicted + rng.normal(0, 0.12, predicted.shape)
    predicted[0, 0] = np.nan
    for mine, slow in zip(
        judge(predicted, keypoints, pairs, mirror), slow_judge(predicted, keypoints, pairs, mirror), strict=True
    ):
        np.testing.assert_array_equal(mine, slow)


def test_swapped_sides_are_forgiven_only_where_asked():
    keypoints = np.zeros((2, len(NAMES), 3))
    keypoints[..., 0] = np.linspace(-0.9, 0.9, len(NAMES)) * 3
    keypoints[..., 2] = 1
    pairs, mirror = np.array([[0, 1]]), mirror_map(NAMES)
    counted, plain, free = judge(keypoints[1, mirror, :2][None], keypoints, pairs, mirror)
    middle = mirror == np.arange(len(NAMES))
    assert counted.all()
    np.testing.assert_array_equal(plain[0], middle)
    assert free.all()


def test_the_tenth_is_of_the_crop():
    keypoints = np.array([[[0.0, 0.0, 1.0]], [[0.0, 0.0, 1.0]]])
    for offset, correct in ((0.199, True), (0.201, False)):
        assert judge(np.array([[[offset, 0.0]]]), keypoints, np.array([[0, 1]]), np.array([0]))[1].item() == correct


def test_equal_topology_gives_the_same_by_index_and_by_lookup():
    predictions, samples = herd(5, rings=15, around=12, length=2.5, height=1.0)
    keypoints, pairs = noisy(samples), ordered_pairs([s.name for s in samples], count=20, seed=0)
    first = transfer_shared_base(predictions, keypoints, pairs)
    second = transfer_canonical(predictions, keypoints, pairs)
    assert np.isfinite(first).any()
    np.testing.assert_allclose(first, second, atol=1e-6)


def test_different_topology_has_no_shared_base():
    predictions, samples = herd(3)
    with pytest.raises(FaunaError, match=r"shared_base: expected one base mesh for dog, got \d+ vertices in dog/000"):
        transfer_shared_base(predictions, points_of(samples), np.array([[0, 1]]))


def test_only_what_is_seen_is_visible():
    prediction, _ = animal("a", azimuth_deg=90.0)
    seen = visible_vertices(prediction)
    depth = prediction.verts @ prediction.camera_from_world[2, :3]
    assert seen.any()
    assert depth[seen].mean() > depth[~seen].mean()
    lonely = replace(prediction, faces=prediction.faces[(prediction.faces != 3).all(axis=1)])
    assert not visible_vertices(lonely)[3]  # it belongs to no face


def test_an_animal_out_of_sight_carries_no_keypoint():
    prediction, sample = animal("a", shift=(50.0, 0.0))
    assert (keypoint_vertices(prediction, sample.keypoints) == -1).all()
    found = transfer_canonical([prediction, prediction], [sample.keypoints] * 2, np.array([[0, 1]]))
    assert np.isnan(found).all()


def test_any_function_can_be_judged():
    asked = []

    def transfer(source, target):
        asked.append((source, target))
        return np.full((2, 2), float(source))

    found = transfer_by_function(transfer, 2, np.array([[0, 1], [2, 0]]))
    assert asked == [(0, 1), (2, 0)]
    assert found[1].tolist() == [[2.0, 2.0]] * 2
    assert transfer_by_function(transfer, 5, np.zeros((0, 2), np.int64)).shape == (0, 5, 2)
