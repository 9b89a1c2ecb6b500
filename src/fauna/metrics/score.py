"""All metrics of a set of predictions, per species and overall, with intervals and with a reason for whatever is missing."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from fauna.errors import FaunaError
from fauna.evaluation.prediction import Prediction
from fauna.metrics.iou import silhouette_iou
from fauna.metrics.sample import Case, LeftOut, Sample, match
from fauna.metrics.tally import Tally, column_values, image_tally, image_values, resampling, summarise


@dataclass(frozen=True)
class Options:
    """Choices of an evaluation.

    Attributes:
        seed: of pairs, splits, surface points.
        pairs: largest number of ordered pairs per species.
        settings: names of settings beyond the plain ones, see :func:`score`.
        flip: whether the model's +z is the tail, see ``fauna.metrics.viewpoint``.
    """

    seed: int
    pairs: int
    settings: frozenset[str]
    flip: bool


@dataclass(frozen=True)
class Outcome:
    """What a metric says about one species: tallies by key, and the images it leaves out."""

    tallies: Mapping[str, Tally]
    left_out: Sequence[LeftOut]


Metric = Callable[[Sequence[Case], Options], Outcome]


def iou_metric(cases: Sequence[Case], options: Options) -> Outcome:
    """``iou``: of the rendered silhouette and the mask."""
    values: list[float | None] = []
    left_out = []
    for case in cases:
        mask, prediction = case.sample.mask, case.prediction
        if mask is None or prediction is None:
            values.append(None)
            left_out.append(LeftOut(case.sample.name, "iou", "no mask" if mask is None else "no prediction"))
            continue
        if mask.shape != prediction.silhouette.shape:
            raise FaunaError(
                f"expected a mask of {prediction.silhouette.shape[0]} pixels for {case.sample.name} as its silhouette, "
                f"got {mask.shape[0]}; load the dataset at the model's image size"
            )
        silhouette = torch.from_numpy(prediction.silhouette.astype(np.float32) / 255)[None]
        values.append(float(silhouette_iou(silhouette, torch.from_numpy(mask).float()[None])[0]))
    return Outcome({"iou": image_tally(values)}, left_out)


METRICS: tuple[Metric, ...] = (iou_metric,)


def score(
    predictions: Sequence[Prediction],
    samples: Sequence[Sample],
    *,
    seed: int,
    pairs: int,
    bootstrap: int,
    settings: Sequence[str] = (),
) -> dict[str, Any]:
    """Score predictions.

    Args:
        predictions: at most one for each sample.
        samples: the annotated photos.
        seed: of pairs, splits, surface points and resampling.
        pairs: largest number of ordered pairs per species (20,000 in the paper); all pairs if there are fewer.
        bootstrap: number of replicates of the intervals.
        settings: further settings, each with suffixed keys.

    Returns:
        ``metrics``: by key ``{value, low, high, n}``, the mean over species; pair metrics also tell ``pairs``.
        ``species``: by name ``{"metrics": ..., "keypoints": {keypoint: {key: {value, n}}}}``.
        ``images``: by photo name and key its own score (of a pair metric: over the pairs it is the target of).
        ``left_out``: ``{name, metric, reason}`` of every image that a metric does not count.

    Raises:
        FaunaError: predictions and samples that do not belong together.
    """
    options = Options(seed, pairs, frozenset(settings), flip=False)
    cases = match(predictions, samples)
    outcomes = {species: [metric(of_species, options) for metric in METRICS] for species, of_species in cases.items()}
    names = {species: [case.sample.name for case in of_species] for species, of_species in cases.items()}
    return report(names, outcomes, seed=seed, bootstrap=bootstrap)


def report(
    names: Mapping[str, Sequence[str]], outcomes: Mapping[str, Sequence[Outcome]], *, seed: int, bootstrap: int
) -> dict[str, Any]:
    """The dictionary of :func:`score` from the outcomes of each species."""
    weights = {species: resampling(names[species], replicates=bootstrap, seed=seed) for species in names}
    tallies: dict[str, dict[str, Tally]] = {}
    for species, of_species in outcomes.items():
        for outcome in of_species:
            for key, tally in outcome.tallies.items():
                tallies.setdefault(key, {})[species] = tally
    result: dict[str, Any] = {
        "metrics": {},
        "species": {species: {"metrics": {}, "keypoints": {}} for species in names},
        "images": {name: {} for species in names for name in names[species]},
        "left_out": sorted(
            (vars(each) for of_species in outcomes.values() for outcome in of_species for each in outcome.left_out),
            key=lambda row: (row["metric"], row["name"]),
        ),
    }
    for key, by_species in tallies.items():
        result["metrics"][key], rows = summarise(by_species, weights)
        for species, tally in by_species.items():
            result["species"][species]["metrics"][key] = rows[species]
            for name, value in zip(names[species], image_values(tally, len(names[species])), strict=True):
                result["images"][name][key] = value
            if tally.columns != ("",):
                for keypoint, row in column_values(tally).items():
                    result["species"][species]["keypoints"].setdefault(keypoint, {})[key] = row
    return result
