"""What a finished predictions folder holds."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fauna.errors import FaunaError
from fauna.evaluation.prediction import Prediction
from fauna.evaluation.records import unpack_prediction, unpack_sample
from fauna.evaluation.store import ArrayStore
from fauna.metrics.sample import Sample

SAMPLES, MODEL, FACTS = "samples", "model", "facts.json"
FORMAT = 2
"""Of ``facts.json``."""


def read_facts(folder: Path) -> dict[str, Any]:
    """``facts.json`` of a predictions folder.

    Raises:
        FaunaError: when it is missing, broken or of another version.
    """
    try:
        facts = json.loads((folder / FACTS).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FaunaError(
            f"predictions: expected a finished predictions folder with {FACTS}, got {folder} ({type(error).__name__}); "
            "name the predictions folder of an evaluation that has ended"
        ) from error
    if not isinstance(facts, dict) or facts.get("format") != FORMAT:
        raise FaunaError(
            f"predictions: expected {folder / FACTS} of format {FORMAT}, got one of another version; evaluate the checkpoint again"
        )
    return facts


def read_predictions(folder: Path, name: str) -> list[Prediction]:
    """Stored predictions of the model, a baseline or a probe.

    Raises:
        FaunaError: when the folder is missing or damaged.
    """
    return [unpack_prediction(item) for item in ArrayStore(folder / name, identity=None).items()]


def read_terms(folder: Path) -> dict[str, dict[str, float]]:
    """Image terms of the model's predictions, by photo."""
    return {item.name: item.notes["terms"] for item in ArrayStore(folder / MODEL, identity=None).items()}


def read_samples(folder: Path, keypoint_names: Sequence[str]) -> tuple[dict[str, Sample], dict[str, bytes]]:
    """Stored samples and their thumbnails, by photo."""
    samples, pictures = {}, {}
    for item in ArrayStore(folder / SAMPLES, identity=None).items():
        samples[item.name] = unpack_sample(item, keypoint_names)
        pictures[item.name] = np.asarray(item.arrays["thumbnail"]).tobytes()
    return samples, pictures
