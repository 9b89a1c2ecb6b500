"""Estimates and intervals against loops."""

import numpy as np
import pytest

from fauna.metrics.tally import Tally, column_values, estimates, image_tally, image_values, resampling, summarise


def slow_estimate(tally, weights):
    """One replicate: every unit is repeated as often as its images were drawn together."""
    shares = []
    for column in range(tally.sums.shape[1]):
        total = count = 0.0
        for unit, owners in enumerate(tally.owners):
            repeats = 1
            for image in owners:
                repeats *= weights[image]
            total += repeats * tally.sums[unit, column]
            count += repeats * tally.counts[unit, column]
        if count:
            shares.append(total / count)
    return sum(shares) / len(shares) if shares else float("nan")


def random_tally(seed, roles=2, images=6, units=25, columns=3):
    rng = np.random.default_rng(seed)
    counts = (rng.random((units, columns)) < 0.5).astype(float)
    owners = rng.integers(0, images, (units, roles))
    return Tally(owners, counts * (rng.random((units, columns)) < 0.5), counts, tuple("abc"[:columns]))


@pytest.mark.parametrize("roles", [1, 2])
def test_estimates_equal_a_loop(roles):
    tally = random_tally(0, roles)
    weights = np.random.default_rng(1).multinomial(6, np.full(6, 1 / 6), size=150).astype(float)
    expected = [slow_estimate(tally, row) for row in weights]
    np.testing.assert_allclose(estimates(tally, weights), expected)


def test_resampling_keeps_the_number_of_images_and_follows_names():
    weights = resampling(["b", "a", "c"], replicates=500, seed=0)
    assert (weights.sum(axis=1) == 3).all()
    np.testing.assert_array_equal(weights[:, [1, 0, 2]], resampling(["a", "b", "c"], replicates=500, seed=0))
    np.testing.assert_allclose(weights.mean(axis=0), 1, atol=0.15)


def test_interval_of_a_mean_is_about_two_standard_errors():
    values = np.random.default_rng(0).normal(size=200)
    names = [f"{i:03d}" for i in range(200)]
    tally = image_tally(list(values))
    row, _ = summarise({"dog": tally}, {"dog": resampling(names, replicates=2000, seed=0)})
    half = 1.96 * values.std() / np.sqrt(200)
    assert row["value"] == pytest.approx(values.mean())
    assert row["low"] == pytest.approx(values.mean() - half, abs=0.02)
    assert row["high"] == pytest.approx(values.mean() + half, abs=0.02)
    assert row["n"] == 200


def test_overall_is_the_mean_over_species():
    tallies = {"cat": image_tally([1.0]), "dog": image_tally([0.0, 0.5, None])}
    weights = {
        name: resampling([str(i) for i in range(n)], replicates=50, seed=0) for name, n in (("cat", 1), ("dog", 3))
    }
    overall, rows = summarise(tallies, weights)
    assert overall["value"] == pytest.approx((1.0 + 0.25) / 2)
    assert overall["n"] == 3
    assert (rows["cat"]["n"], rows["dog"]["n"]) == (1, 2)
    assert rows["cat"]["low"] is rows["cat"]["high"] is None  # one photo has no spread


def test_nothing_is_none_and_not_nan():
    tally = image_tally([None, None])
    overall, rows = summarise({"dog": tally}, {"dog": resampling(["a", "b"], replicates=20, seed=0)})
    assert overall == rows["dog"] == {"value": None, "low": None, "high": None, "n": 0}
    assert column_values(tally) == {"": {"value": None, "n": 0}}
    assert image_values(tally, 2) == [None, None]


def test_no_replicates_no_interval():
    row, _ = summarise({"dog": image_tally([0.5])}, {"dog": resampling(["a"], replicates=0, seed=0)})
    assert row == {"value": 0.5, "low": None, "high": None, "n": 1}


def test_image_values_of_pairs_belong_to_the_target():
    tally = Tally(np.array([[0, 1], [2, 1], [1, 0]]), np.array([[1.0, 0], [1, 1], [0, 0]]), np.ones((3, 2)), ("a", "b"))
    assert image_values(tally, 3) == [0.0, 0.75, None]
    assert column_values(tally) == {
        "a": {"value": pytest.approx(2 / 3), "n": 3},
        "b": {"value": pytest.approx(1 / 3), "n": 3},
    }
