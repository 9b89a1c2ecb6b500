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


def photos_digest(photos: Iterable[Photo]) -> str:
    """Digest of names and pictures, in any order."""
    rows = sorted(f"{photo.name} {photo.source.content_key()}" for photo in photos)
    return hashlib.sha256("\n".join(rows).encode()).hexdigest()


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
