"""Feature statistics against numpy, and the properties of the targets."""

import numpy as np
import pytest
import torch
from torch import Tensor

from fauna.encoder.feature_space import FeatureSpace
from fauna.errors import FaunaError
from fauna.types import Features

SETTINGS = {
    "global_dim": 5,
    "token_dim": 6,
    "num_components": 3,
    "target_source": "tokens",
    "target_sigmas": 5.0,
    "foreground_threshold": 0.7,
    "standardize_global": True,
    "standardize_tokens": True,
    "max_images": 100,
    "whitening": 0.0,
}


def make(**changes) -> FeatureSpace:
    return FeatureSpace(**{**SETTINGS, **changes})


def random_features(count: int, seed: int, *, shared: bool = True) -> tuple[Features, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    mixing = torch.randn(6, 6, generator=torch.Generator().manual_seed(99))
    tokens = torch.einsum("bchw,dc->bdhw", torch.randn(count, 6, 4, 4, generator=generator), mixing) + 1
    keys = tokens if shared else torch.randn(count, 6, 4, 4, generator=generator) * 3
    masks = (torch.rand(count, 16, 16, generator=generator) > 0.25).float()
    return Features(torch.randn(count, 5, generator=generator) * 4 + 2, tokens, keys), masks


def foreground_vectors(batches, source="tokens") -> np.ndarray:
    """Slow: loop over cells, keep those covered by more than 70 %."""
    kept = []
    for features, masks in batches:
        maps = getattr(features, source)
        for photo in range(len(masks)):
            for row in range(4):
                for column in range(4):
                    cell = masks[photo, row * 4 : row * 4 + 4, column * 4 : column * 4 + 4]
                    if cell.mean() > 0.7:
                        vector = maps[photo, :, row, column].double().numpy()
                        kept.append(vector / np.linalg.norm(vector))
    return np.stack(kept)


@pytest.mark.parametrize("source", ["tokens", "keys"])
def test_components_against_numpy(source):
    batches = [random_features(3, seed, shared=False) for seed in range(5)]
    space = make(target_source=source)
    space.fit(batches)
    vectors = foreground_vectors(batches, source)
    variances, axes = np.linalg.eigh(np.cov(vectors.T, bias=True))
    variances, axes = variances[::-1], axes[:, ::-1].T[:3]
    axes = axes * np.sign(axes[np.arange(3), np.abs(axes).argmax(1)])[:, None]
    np.testing.assert_allclose(space.components.numpy(), axes, atol=1e-5)
    np.testing.assert_allclose(space.pca_mean.numpy(), vectors.mean(0), atol=1e-6)
    np.testing.assert_allclose(space.explained_variance.numpy(), (variances / variances.sum())[:3], rtol=1e-5)
    assert float(space.target_scale) == pytest.approx(1 / (5 * variances[0] ** 0.5), rel=1e-5)

    features, _ = batches[0]
    vector = getattr(features, source)[1, :, 2, 3].double().numpy()
    expected = 0.5 + axes @ (vector / np.linalg.norm(vector) - vectors.mean(0)) / (5 * variances[0] ** 0.5)
    np.testing.assert_allclose(space.targets(features)[1, :, 2, 3].numpy(), expected.clip(0, 1), atol=1e-5)


def test_targets_lie_in_the_unit_interval_and_keep_relative_scale():
    features, masks = random_features(60, 0)
    space = make()
    space.fit([(features, torch.ones_like(masks))])
    targets = space.targets(features)
    assert targets.shape == (60, 3, 4, 4)
    assert targets.min() >= 0
    assert targets.max() <= 1
    deviation = targets.transpose(0, 1).flatten(1).std(dim=1)
    assert deviation[0] == pytest.approx(0.2, rel=0.02)  # 1 / target_sigmas
    ratio = (deviation / deviation[0]) ** 2
    expected = space.explained_variance / space.explained_variance[0]
    assert torch.allclose(ratio, expected, rtol=0.05)
    assert torch.allclose(targets.transpose(0, 1).flatten(1).mean(1), torch.full((3,), 0.5), atol=1e-3)


def test_normalize_standardises_what_was_fitted():
    features, masks = random_features(50, 1, shared=False)
    space = make()
    space.fit([(features, masks)])
    normal = space.normalize(features)
    for values in (normal.global_, *(m.permute(0, 2, 3, 1).reshape(-1, 6) for m in (normal.tokens, normal.keys))):
        assert torch.allclose(values.mean(0), torch.zeros(values.shape[1]), atol=1e-4)
        assert torch.allclose(values.std(0, correction=0), torch.ones(values.shape[1]), atol=1e-4)


def test_normalize_can_be_switched_off_and_keeps_sharing():
    features, masks = random_features(10, 2)
    plain = make(standardize_global=False, standardize_tokens=False)
    plain.fit([(features, masks)])
    same = plain.normalize(features)
    assert same.global_ is features.global_
    assert same.tokens is features.tokens
    assert same.keys is same.tokens
    full = make()
    full.fit([(features, masks)])
    normal = full.normalize(features)
    assert normal.keys is normal.tokens


def test_sign_does_not_depend_on_the_sign_of_the_data_order():
    batches = [random_features(4, seed) for seed in range(3)]
    first, second = make(), make()
    first.fit(batches)
    second.fit(reversed(batches))
    assert torch.allclose(first.components, second.components, atol=1e-5)
    peaks = first.components.gather(1, first.components.abs().argmax(1, keepdim=True))
    assert (peaks > 0).all()


def test_fit_is_bitwise_repeatable_and_survives_a_checkpoint():
    batches = [random_features(4, seed) for seed in range(3)]
    first, second, loaded = make(), make(), make()
    first.fit(batches)
    second.fit(iter(batches))
    loaded.load_state_dict(first.state_dict())
    for name, value in first.state_dict().items():
        assert torch.equal(value, second.state_dict()[name]), name
    assert torch.equal(loaded.targets(batches[0][0]), first.targets(batches[0][0]))


def test_stops_after_max_images_and_reads_no_more():
    def stream():
        yield random_features(3, 0)
        yield random_features(3, 1)
        pytest.fail("read beyond max_images")

    limited, exact = make(max_images=5), make()
    limited.fit(stream())
    second, masks = random_features(3, 1)
    exact.fit([random_features(3, 0), (second.rows(torch.tensor([0, 1])), masks[:2])])
    assert torch.equal(limited.components, exact.components)
    assert torch.equal(limited.global_mean, exact.global_mean)


def test_constant_channels_stay_finite():
    features, masks = random_features(20, 5)
    features.global_[:, 0] = 3.0
    features.tokens[:, 0] = 0.0
    space = make()
    space.fit([(features, masks)])
    normal = space.normalize(features)
    assert torch.isfinite(normal.global_).all()
    assert torch.isfinite(normal.tokens).all()
    assert torch.isfinite(space.targets(features)).all()


def test_unfitted_or_unfittable_is_an_error():
    space = make()
    features, masks = random_features(2, 0)
    for use in (space.normalize, space.targets):
        with pytest.raises(FaunaError, match="expects fitted statistics"):
            use(features)
    with pytest.raises(FaunaError, match="more than 3 foreground cells to fit, got 0"):
        space.fit([(features, torch.zeros_like(masks))])
    with pytest.raises(FaunaError, match="expects 1..6 components"):
        make(num_components=7)


def test_loading_unfitted_statistics_is_noticed_although_it_was_fitted():
    space, empty = make(), make()
    features, masks = random_features(10, 0)
    space.fit([(features, masks)])
    space.normalize(features)
    space.load_state_dict(empty.state_dict())
    with pytest.raises(FaunaError, match="expects fitted statistics"):
        space.normalize(features)


def test_the_flag_is_read_from_the_device_once(monkeypatch):
    space = make()
    features, masks = random_features(10, 0)
    space.fit([(features, masks)])
    reads = []
    original = Tensor.__bool__
    monkeypatch.setattr(Tensor, "__bool__", lambda tensor: reads.append(tensor) or original(tensor))
    for _ in range(3):
        space.normalize(features)
        space.targets(features)
    assert len(reads) == 1


@pytest.mark.parametrize("whitening", [0.0, 0.5, 1.0])
def test_whitening_raises_small_components(whitening):
    batches = [random_features(8, seed) for seed in range(6)]
    space = make(whitening=whitening, target_sigmas=50.0)  # nothing is clamped
    space.fit(batches)
    kept = []
    for features, masks in batches:
        covered = torch.nn.functional.adaptive_avg_pool2d(masks[:, None], 4)[:, 0] > 0.7
        kept.append(space.targets(features).permute(0, 2, 3, 1)[covered])
    deviations = torch.cat(kept).std(dim=0, correction=0)
    variances = space.explained_variance
    expected = (variances / variances[0]).sqrt() ** (1.0 - whitening) / 50.0
    torch.testing.assert_close(deviations, expected, rtol=1e-3, atol=1e-6)
