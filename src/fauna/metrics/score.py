"""All metrics of a set of predictions, per species and overall, with intervals and with a reason for whatever is missing."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fauna.errors import FaunaError
from fauna.evaluation.prediction import Prediction
from fauna.metrics.iou import iou_metric
from fauna.metrics.keypoint_metrics import map_metric, pair_outcome, transfer_metric
from fauna.metrics.outcome import Metric, Options, Outcome
from fauna.metrics.sample import Sample, match
from fauna.metrics.tally import Tally, column_values, image_values, resampling, summarise
from fauna.metrics.transfer import Transfer, transfer_by_function
from fauna.metrics.truth_metrics import global_flip, surface_metric, viewpoint_metric

METRICS: tuple[Metric, ...] = (iou_metric, transfer_metric, map_metric, surface_metric, viewpoint_metric)
SHARED_BASE = "shared_base"
SETTINGS = (SHARED_BASE, "fit_on_test", "similarity")


def score(
    predictions: Sequence[Prediction],
    samples: Sequence[Sample],
    *,
    seed: int,
    pairs: int,
    bootstrap: int,
    settings: Sequence[str] = ("fit_on_test", "similarity"),
    flip: bool | None = None,
    shared: Sequence[Prediction] | None = None,
) -> dict[str, Any]:
    """Score predictions.

    Args:
        predictions: at most one for each sample.
        samples: the annotated photos.
        seed: of pairs, splits, surface points and resampling.
        pairs: largest number of ordered pairs per species (20,000 in the paper); all pairs if there are fewer.
        bootstrap: number of replicates of the intervals.
        settings: settings beyond the plain ones, with keys of their own: ``shared_base`` (keypoint transfer by vertex index
            between ``shared``), ``fit_on_test`` (keypoint map fitted and tested on all photos), ``similarity``
            (surfaces compared after a rigid alignment with scale).
        flip: whether the model's +z is the tail; ``None`` = decided on these photos (:func:`model_flip`).
        shared: predictions with equal triangles within a species, at most one for each sample; ``None`` = ``predictions``.

    Returns:
        ``metrics``: by key ``{value, low, high, n}``, the mean over species; pair metrics also tell ``pairs``. ``global_flip`` is 1
        if all predictions were turned by half a turn for viewpoint and legs.
        ``species``: by name ``{"metrics": ..., "keypoints": {keypoint: {key: {value, n}}}}``.
        ``images``: by photo name and key its own score (of a pair metric: over the pairs it is the target of).
        ``left_out``: ``{name, metric, reason}`` of every image that a metric does not count.

    Raises:
        FaunaError: predictions and samples that do not belong together, an unknown setting.
    """
    return score_with_tallies(
        predictions, samples, seed=seed, pairs=pairs, bootstrap=bootstrap, settings=settings, flip=flip, shared=shared
    )[0]


def score_with_tallies(
    predictions: Sequence[Prediction],
    samples: Sequence[Sample],
    *,
    seed: int,
    pairs: int,
    bootstrap: int,
    settings: Sequence[str],
    flip: bool | None,
    shared: Sequence[Prediction] | None,
) -> tuple[dict[str, Any], dict[str, dict[str, Tally]]]:
    """The same, and by key and species the sums behind the numbers; their owners count the photos of a species as ``images`` does."""
    check_settings(settings)
    cases = match(predictions, samples, predictions if shared is None else shared)
    flip = model_flip(predictions, samples) if flip is None else flip
    options = Options(seed, pairs, frozenset(settings), bool(flip))
    outcomes = {species: [metric(of_species, options) for metric in METRICS] for species, of_species in cases.items()}
    names = {species: [case.sample.name for case in of_species] for species, of_species in cases.items()}
    tallies = _tallies(outcomes)
    result = report(names, outcomes, seed=seed, bootstrap=bootstrap)
    count = result["metrics"]["azimuth_error_deg"]["n"] if cases else 0
    result["metrics"]["global_flip"] = {
        "value": None if flip is None else float(flip),
        "low": None,
        "high": None,
        "n": count,
    }
    return result, tallies


def check_settings(settings: Sequence[str]) -> None:
    """Refuse unknown names.

    Raises:
        FaunaError: naming the first.
    """
    unknown = sorted(set(map(str, settings)) - set(SETTINGS))
    if unknown:
        raise FaunaError(f"settings: expected names among {', '.join(SETTINGS)}, got {unknown[0]!r}; choose among them")


def model_flip(predictions: Sequence[Prediction], samples: Sequence[Sample]) -> bool | None:
    """Whether a model's +z is the tail: one answer for all photos it is scored on, ``None`` without truth."""
    return global_flip(match(predictions, samples))


def score_transfer(
    transfer: Transfer, samples: Sequence[Sample], *, seed: int, pairs: int, bootstrap: int
) -> dict[str, Any]:
    """``kt_pck@0.1`` and ``kt_pck@0.1_lr_free`` of any method, on the same pairs and by the same rule as :func:`score`.

    Args:
        transfer: from indices of source and target into ``samples`` to (key, 2) positions in the target, NDC; NaN is a miss.
        samples: the annotated photos.
        seed: of pairs and resampling.
        pairs: largest number of ordered pairs per species.
        bootstrap: number of replicates of the intervals.

    Returns:
        As :func:`score`.
    """
    options = Options(seed, pairs, frozenset(), flip=False)
    place = {sample.name: index for index, sample in enumerate(samples)}
    cases = match((), samples)
    names = {species: [case.sample.name for case in of_species] for species, of_species in cases.items()}
    outcomes = {}
    for species, of_species in cases.items():
        index = np.array([place[name] for name in names[species]])
        number = len(of_species[0].sample.keypoint_names)
        outcomes[species] = [
            pair_outcome(
                of_species,
                options,
                [None] * len(of_species),
                lambda rows, index=index, number=number: transfer_by_function(transfer, number, index[rows]),
                "",
            )
        ]
    return report(names, outcomes, seed=seed, bootstrap=bootstrap)


def report(
    names: Mapping[str, Sequence[str]], outcomes: Mapping[str, Sequence[Outcome]], *, seed: int, bootstrap: int
) -> dict[str, Any]:
    """The dictionary of :func:`score` from the outcomes of each species."""
    weights = {species: resampling(names[species], replicates=bootstrap, seed=seed) for species in names}
    result: dict[str, Any] = {
        "metrics": {},
        "species": {species: {"metrics": {}, "keypoints": {}} for species in names},
        "images": {name: {} for species in names for name in names[species]},
        "left_out": sorted(
            (vars(each) for of_species in outcomes.values() for outcome in of_species for each in outcome.left_out),
            key=lambda row: (row["metric"], row["name"]),
        ),
    }
    for key, by_species in _tallies(outcomes).items():
        result["metrics"][key], rows = summarise(by_species, weights)
        for species, tally in by_species.items():
            result["species"][species]["metrics"][key] = rows[species]
            for name, value in zip(names[species], image_values(tally, len(names[species])), strict=True):
                result["images"][name][key] = value
            if tally.columns != ("",):
                for keypoint, row in column_values(tally).items():
                    result["species"][species]["keypoints"].setdefault(keypoint, {})[key] = row
    return result


def _tallies(outcomes: Mapping[str, Sequence[Outcome]]) -> dict[str, dict[str, Tally]]:
    """By key and species."""
    found: dict[str, dict[str, Tally]] = {}
    for species, of_species in outcomes.items():
        for outcome in of_species:
            for key, tally in outcome.tallies.items():
                found.setdefault(key, {})[species] = tally
    return found
