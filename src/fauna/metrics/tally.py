"""From counts to numbers: means over keypoints and species, and bootstrap intervals over images."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from fauna.random import derive_seed

PERCENTILES = (2.5, 97.5)
CHUNK = 64  # replicates weighed at a time: bounds the memory for many pairs


@dataclass(frozen=True)
class Tally:
    """Sums behind one metric of one species. The value is the mean over columns of (sum / count), empty columns left out.

    Attributes:
        owners: (unit, role) images that a unit belongs to: itself, or the source and the target of a pair.
        sums: (unit, column) what is averaged, e.g. 1 for a correct keypoint.
        counts: (unit, column) 1 where it counts, else 0.
        columns: keypoint names; a single empty name for metrics without keypoints.
    """

    owners: Int[np.ndarray, "unit role"]
    sums: Float[np.ndarray, "unit column"]
    counts: Float[np.ndarray, "unit column"]
    columns: tuple[str, ...]


def image_tally(values: Sequence[float | None]) -> Tally:
    """Tally of a metric with one number per image, ``None`` where it is left out."""
    counts = np.array([[0.0 if value is None else 1.0] for value in values]).reshape(-1, 1)
    sums = np.array([[0.0 if value is None else float(value)] for value in values]).reshape(-1, 1)
    return Tally(np.arange(len(values))[:, None], sums, counts, ("",))


def resampling(names: Sequence[str], *, replicates: int, seed: int) -> Float[np.ndarray, "replicate image"]:
    """How often each image of a species is drawn in each bootstrap replicate; the same for every metric."""
    rng = np.random.default_rng(derive_seed(seed, "bootstrap", *sorted(names)))
    share = np.full(len(names), 1.0 / len(names))
    drawn = rng.multinomial(len(names), share, size=replicates).astype(np.float64)
    return drawn[:, np.argsort(np.argsort(np.array(names)))]


def estimates(tally: Tally, weights: Float[np.ndarray, "replicate image"]) -> Float[np.ndarray, " replicate"]:
    """Value under each set of image weights, NaN where nothing counts. A pair weighs the product of its images' weights."""
    values = np.full(len(weights), np.nan)
    table = np.concatenate([tally.sums, tally.counts], axis=1)
    for start in range(0, len(weights), CHUNK):
        chunk = weights[start : start + CHUNK]
        by_unit = np.prod([chunk[:, role] for role in tally.owners.T], axis=0)  # (replicate, unit)
        sums, counts = np.split(by_unit @ table, 2, axis=1)
        values[start : start + CHUNK] = _column_mean(sums, counts)
    return values


def column_values(tally: Tally) -> dict[str, dict[str, Any]]:
    """Value and count of every column."""
    sums, counts = tally.sums.sum(axis=0), tally.counts.sum(axis=0)
    return {
        name: {"value": float(total / count) if count else None, "n": int(count)}
        for name, total, count in zip(tally.columns, sums, counts, strict=True)
    }


def image_values(tally: Tally, number: int) -> list[float | None]:
    """Score of each image: its share of what counted; of a pair the *target* owns it."""
    target = tally.owners[:, -1]
    sums = np.bincount(target, tally.sums.sum(axis=1), number)
    counts = np.bincount(target, tally.counts.sum(axis=1), number)
    return [float(total / count) if count else None for total, count in zip(sums, counts, strict=True)]


def summarise(
    tallies: Mapping[str, Tally], weights: Mapping[str, Float[np.ndarray, "replicate image"]]
) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """One metric over all species and of each.

    Args:
        tallies: by species.
        weights: of :func:`resampling`, by species.

    Returns:
        ``{"value", "low", "high", "n"}`` of the mean over species, and the same of each species. ``n`` counts images with
        at least one unit that counts, ``pairs`` the pairs where units are pairs. ``value`` is ``None`` where ``n`` is 0.
    """
    rows, replicates, values = {}, [], []
    for species, tally in tallies.items():
        value = estimates(tally, np.ones((1, weights[species].shape[1])))[0]
        spread = estimates(tally, weights[species])
        rows[species] = _row(value, spread, tally)
        if np.isfinite(value):
            values.append(value)
            replicates.append(spread)
    overall = _row(float(np.mean(values)) if values else np.nan, mean_ignoring_nan(replicates), *tallies.values())
    return overall, rows


def _row(value: float, spread: Float[np.ndarray, " replicate"], *tallies: Tally) -> dict[str, Any]:
    spread = spread[np.isfinite(spread)]
    counted = [tally.owners[tally.counts.any(axis=1)] for tally in tallies]
    number = sum(len(np.unique(owners)) for owners in counted)
    known = len(spread) > 0 and np.isfinite(value) and number > 1  # one photo has no spread
    low, high = np.percentile(spread, PERCENTILES) if known else (None, None)
    row = {
        "value": float(value) if np.isfinite(value) else None,
        "low": None if low is None else float(low),
        "high": None if high is None else float(high),
        "n": number,
    }
    if any(owners.shape[1] == 2 for owners in counted):
        row["pairs"] = sum(map(len, counted))
    return row


def _column_mean(
    sums: Float[np.ndarray, "replicate column"], counts: Float[np.ndarray, "replicate column"]
) -> Float[np.ndarray, " replicate"]:
    shares = np.divide(sums, counts, out=np.zeros_like(sums), where=counts > 0)
    used = (counts > 0).sum(axis=1)
    return np.where(used > 0, shares.sum(axis=1) / np.maximum(used, 1), np.nan)


def mean_ignoring_nan(rows: Sequence[Float[np.ndarray, " replicate"]]) -> Float[np.ndarray, " replicate"]:
    """Mean over species in each replicate, of those that have a value there; NaN where none has."""
    if not rows:
        return np.zeros(0)
    finite = np.isfinite(rows)
    totals = np.where(finite, rows, 0.0).sum(axis=0)
    return np.where(finite.any(axis=0), totals / np.maximum(finite.sum(axis=0), 1), np.nan)
