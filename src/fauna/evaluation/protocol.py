"""What a report says about itself: data, checkpoint, versions, rules, and the meaning of its keys."""

import hashlib
import platform
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import scipy
import torch

import fauna
from fauna.data.photos import Photo
from fauna.errors import FaunaError
from fauna.metrics.keys import definition

RULES = {
    "crop": "square around the mask's centroid, side max(2 sqrt(area), 1.04 x extent); ready-made crops are taken as they are",
    "prediction": "one photograph at a time: own shape code and base shape, most likely viewpoint, nothing mirrored or averaged",
    "error": "keypoint errors are divided by the side of the crop",
    "means": "per species the mean over keypoints, overall the mean over species; fractions from 0 to 1",
    "intervals": "95 %, percentile bootstrap over images (of a pair metric, too, images are drawn, not pairs)",
    "correspondence": "canonical: a surface point is found again by bone, side of the body and bone coordinates",
    "flip": "one front-back flip for all predictions of a model is allowed in 3D metrics, and reported as global_flip",
}


def versions() -> dict[str, str]:
    """Of what computed the report."""
    return {
        "fauna": fauna.__version__,
        "python": platform.python_version(),
        "torch": torch.__version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }


def photo_keys(photos: Iterable[Photo]) -> dict[str, str]:
    """By name a key that changes with a photograph's picture, mask, box or keypoints; files may be missing."""
    return {photo.name: _key(photo) for photo in photos}


def _key(photo: Photo) -> str:
    try:
        return f"{photo.source.content_key()} {photo.source.annotation_key()}".strip()
    except FaunaError:  # said when the photograph's turn comes
        return "unreadable"


def photos_digest(keys: Mapping[str, str]) -> str:
    """Digest of the names and keys of photographs."""
    return hashlib.sha256("\n".join(sorted(f"{name} {key}" for name, key in keys.items())).encode()).hexdigest()


def training_warning(dataset: Mapping[str, Any]) -> str | None:
    """What a reader must know about photographs of the training among those of the report; ``None`` if there are none.

    Args:
        dataset: ``dataset`` of the protocol.
    """
    training = dataset["training_photos"]
    if training["unknown"]:
        return f"whether the checkpoint was trained on some of the photographs is not known: {training['unknown']}"
    if training["included"]:
        return f"{training['included']} of the photographs are of those the checkpoint was trained on"
    return None


def build_protocol(facts: Mapping[str, Any], options: Mapping[str, Any], keys: Iterable[str]) -> dict[str, Any]:
    """The report's ``protocol``.

    Args:
        facts: of the predictions folder.
        options: of the scoring.
        keys: metrics that the report holds.
    """
    groups = facts["groups"]
    return {
        "dataset": facts["dataset"],
        "split": facts["split"],
        "photos": {name: len(names) for name, names in groups.items()},
        "size": facts["size"],
        "keypoint_names": facts["keypoint_names"],
        "checkpoint": facts["checkpoint"],
        **options,
        "rules": RULES,
        "definitions": {key: definition(key) for key in sorted(set(keys))},
        "versions": versions(),
    }
