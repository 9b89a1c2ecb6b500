"""Reads a predictions folder; needs neither model nor dataset."""

import functools
import json
import operator
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fauna.errors import FaunaError
from fauna.evaluation.prediction import Prediction
from fauna.evaluation.records import unpack_prediction, unpack_sample
from fauna.evaluation.store import ArrayStore, Item
from fauna.metrics.sample import Sample

SAMPLES, MODEL, FACTS = "samples", "model", "facts.json"
FORMAT = 2
"""Of ``facts.json``."""
NEEDED = (
    *("checkpoint.sha256", "checkpoint.config", "checkpoint.species", "dataset.sha256", "dataset.identity"),
    *(
        "dataset.training_photos.included",
        "dataset.training_photos.unknown",
        "groups",
        "size",
        "split",
        "keypoint_names",
    ),
    *("settings.baselines", "settings.probes", "settings.probed", "left_out", "timing"),
)
"""What every ``facts.json`` holds, as dotted keys."""

T = TypeVar("T")


def read_facts(folder: Path) -> dict[str, Any]:
    """``facts.json`` of a predictions folder.

    Raises:
        FaunaError: when it is missing, broken, of another version, or lacks something.
    """
    try:
        facts = json.loads((folder / FACTS).read_text(encoding="utf-8"))
        if isinstance(facts, dict) and facts.get("format") != FORMAT:
            raise FaunaError(
                f"predictions: expected {folder / FACTS} of format {FORMAT}, got one of another version; evaluate the checkpoint again"
            )
        for path in NEEDED:
            functools.reduce(operator.getitem, path.split("."), facts)
        return facts
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FaunaError(
            f"predictions: expected a finished predictions folder with {FACTS}, got {folder} ({type(error).__name__}); "
            "name the predictions folder of an evaluation that has ended"
        ) from error


def read_predictions(folder: Path, name: str) -> list[Prediction]:
    """Stored predictions of the model, a baseline or a probe.

    Raises:
        FaunaError: when the folder is missing or damaged.
    """
    return list(_unpacked(folder / name, unpack_prediction))


def read_terms(folder: Path) -> dict[str, dict[str, float]]:
    """Image terms of the model's predictions, by photo.

    Raises:
        FaunaError: when the folder is missing or damaged.
    """
    return dict(_unpacked(folder / MODEL, lambda item: (item.name, item.notes["terms"])))


def read_samples(folder: Path, keypoint_names: Sequence[str]) -> tuple[dict[str, Sample], dict[str, bytes]]:
    """Stored samples and their thumbnails, by photo.

    Raises:
        FaunaError: when the folder is missing or damaged.
    """

    def unpack(item: Item) -> tuple[Sample, bytes]:
        return unpack_sample(item, keypoint_names), np.asarray(item.arrays["thumbnail"]).tobytes()

    found = list(_unpacked(folder / SAMPLES, unpack))
    return {sample.name: sample for sample, _ in found}, {sample.name: picture for sample, picture in found}


def _unpacked(folder: Path, unpack: Callable[[Item], T]) -> Iterator[T]:
    for item in ArrayStore(folder, identity=None).items():
        try:
            yield unpack(item)
        except (KeyError, TypeError, ValueError) as error:
            raise FaunaError(
                f"{folder} expects whole records, got {item.name} without {error}; delete the folder and evaluate anew"
            ) from error
