"""What is known about a photograph for scoring, and its meeting with what a model said about it."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from fauna.data.truth import Truth3D
from fauna.errors import FaunaError
from fauna.evaluation.prediction import Prediction


@dataclass(frozen=True)
class Sample:
    """Annotation of one crop.

    Attributes:
        name: of the photo, unique within the dataset.
        category: species.
        mask: True on the animal; ``None`` where the dataset has no mask.
        keypoints: NDC x, y (y down) and 1 where annotated; ``None`` where the dataset has none.
        keypoint_names: of ``keypoints`` and ``truth.keypoints``, the same for all photos of a species.
        truth: geometry behind the crop, where it is known.
    """

    name: str
    category: str
    mask: Bool[np.ndarray, "size size"] | None
    keypoints: Float[np.ndarray, "key 3"] | None
    keypoint_names: tuple[str, ...]
    truth: Truth3D | None


@dataclass(frozen=True)
class LeftOut:
    """An image that a metric does not count, and why."""

    name: str
    metric: str
    reason: str


@dataclass(frozen=True)
class Case:
    """A sample with its prediction.

    Attributes:
        sample: the annotation.
        prediction: ``None`` if the model gave none.
        fault: why the predicted mesh cannot be used, ``None`` if it can.
        shared: prediction whose base mesh the whole species shares, ``None`` if there is none.
        shared_fault: likewise.
    """

    sample: Sample
    prediction: Prediction | None
    fault: str | None
    shared: Prediction | None
    shared_fault: str | None

    @property
    def mesh(self) -> Prediction:
        """The prediction; asked for only where there is no fault."""
        assert self.prediction is not None, f"{self.sample.name} has no mesh"
        return self.prediction


def match(
    predictions: Sequence[Prediction], samples: Sequence[Sample], shared: Sequence[Prediction] = ()
) -> dict[str, tuple[Case, ...]]:
    """Cases by species, species and names sorted, so that no score depends on the order of the arguments.

    Args:
        predictions: at most one for each sample.
        samples: the annotated photos.
        shared: predictions with one base mesh per species, at most one for each sample.

    Raises:
        FaunaError: names that repeat, predictions without a sample or of another species, keypoints that do not fit
            their names, names that differ within a species.
    """
    for what, named in (("samples", samples), ("predictions", predictions), ("shared predictions", shared)):
        names = [each.name for each in named]
        repeated = [name for name, count in Counter(names).items() if count > 1]
        if repeated:
            raise FaunaError(f"expected {what} with unique names, got {repeated[0]} more than once; rename or drop it")
    known = {sample.name: sample for sample in samples}
    for prediction in (*predictions, *shared):
        if prediction.name not in known:
            raise FaunaError(f"expected predictions of the samples, got one of {prediction.name}; add its sample")
        if prediction.category != known[prediction.name].category:
            raise FaunaError(
                f"expected a prediction of {known[prediction.name].category} for {prediction.name}, "
                f"got one of {prediction.category}; predict it again"
            )
    by_name, by_name_shared = ({each.name: each for each in which} for which in (predictions, shared))
    found: dict[str, list[Case]] = {}
    for name in sorted(known):
        own, of_all = by_name.get(name), by_name_shared.get(name)
        case = Case(known[name], own, _fault(own), of_all, _fault(of_all))
        found.setdefault(known[name].category, []).append(case)
    for cases in found.values():
        _check_keypoints(cases)
    return {species: tuple(found[species]) for species in sorted(found)}


def annotated(sample: Sample) -> Float[np.ndarray, "key 3"]:
    """Keypoints with flags of exactly 0 or 1; not finite ones count as not annotated and are put at 0."""
    if sample.keypoints is None:
        return np.zeros((len(sample.keypoint_names), 3))
    points = sample.keypoints.astype(np.float64)
    flag = (points[:, 2] > 0.5) & np.isfinite(points).all(axis=1)
    return np.where(flag[:, None], np.column_stack([points[:, :2], flag]), 0.0)


def _fault(prediction: Prediction | None) -> str | None:
    if prediction is None:
        return "no prediction"
    if not len(prediction.verts) or not len(prediction.faces):
        return "empty mesh"
    numbers = (
        prediction.verts,
        prediction.canonical,
        prediction.local,
        prediction.camera_from_world,
        prediction.clip_from_world,
    )
    return None if all(np.isfinite(each).all() for each in numbers) else "prediction is not finite"


def _check_keypoints(cases: Sequence[Case]) -> None:
    first = cases[0].sample
    for sample in (case.sample for case in cases):
        if sample.keypoint_names != first.keypoint_names:
            raise FaunaError(
                f"expected equal keypoint names within {first.category}, got others for {sample.name} than for {first.name}; "
                "score them as two species"
            )
        if sample.keypoints is not None and len(sample.keypoints) != len(sample.keypoint_names):
            raise FaunaError(
                f"expected {len(sample.keypoint_names)} keypoints for {sample.name}, got {len(sample.keypoints)}; "
                "mend its annotation"
            )
