"""What a report says about itself: data, checkpoint, versions, rules, and the exact meaning of every key."""

import hashlib
import platform
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import scipy
import torch

import fauna
from fauna.data.photos import Photo

RULES = {
    "crop": "square around the mask's centroid, side max(2 sqrt(area), 1.04 x extent); ready-made crops are taken as they are",
    "prediction": "one photograph at a time: own shape code and base shape, most likely viewpoint, nothing mirrored or averaged",
    "error": "keypoint errors are divided by the side of the crop",
    "means": "per species the mean over keypoints, overall the mean over species; fractions from 0 to 1",
    "intervals": "95 %, percentile bootstrap over images (of a pair metric, too, images are drawn, not pairs)",
    "correspondence": "canonical: a surface point is found again by bone, side of the body and bone coordinates",
    "flip": "one front-back flip for all predictions of a model is allowed in 3D metrics, and reported as global_flip",
}

DEFINITIONS = {
    "iou": "intersection over union of the rendered silhouette and the mask, both thresholded at one half",
    "kt_pck@0.1": "keypoint transfer: source keypoint -> nearest visible vertex -> corresponding point of the target -> "
    "projected; share within 0.1 crop sides, over ordered pairs of one species where source and target are annotated",
    "kt_pck@0.1_lr_free": "the same, each pair free to swap left and right",
    "pck@0.1": "share of keypoints within 0.1 crop sides, predicted as mixtures of surface points; the mixtures are fitted on one "
    "half of the photographs of the species and tested on the other",
    "pck@0.1_fit_on_test": "the same, fitted and tested on all photographs",
    "novel_view_iou": "silhouette IoU with the truth from 8 views around it, aligned in the camera frame by scale and depth",
    "chamfer": "mean two-way distance of the surfaces, share of the truth's size (diagonal of its box), aligned in the camera frame "
    "by scale and depth only; lower is better",
    "chamfer_similarity": "the same after a rigid alignment with scale",
    "f_score": "harmonic mean of precision and recall of surface points within 5 % of the truth's size, aligned in the camera frame",
    "f_score_similarity": "the same after a rigid alignment with scale",
    "volume_iou": "intersection over union of the solids, aligned in the camera frame",
    "volume_iou_similarity": "the same after a rigid alignment with scale",
    "pa_mpjpe": "mean 3D keypoint error of the fitted mixtures after Procrustes alignment, share of the truth's size; lower is better",
    "azimuth_error_deg": "angle between predicted and true heading about the vertical; lower is better",
    "azimuth_within_30": "share of photographs with a heading at most 30 degrees off",
    "elevation_error_deg": "angle between predicted and true elevation; lower is better",
    "front_back_flips": "share of photographs seen from the wrong end; lower is better",
    "left_right_flips": "share of photographs where the animal heads to the wrong side; lower is better",
    "leg_chamfer": "distance of each true leg to the predicted surface labelled with that leg's bones; lower is better",
    "global_flip": "1 where all predictions were turned half round because the model's +z is the tail",
}
"""Meaning of each key; suffixes name a further setting of the same metric."""

LOWER_IS_BETTER = ("chamfer", "pa_mpjpe", "azimuth_error", "elevation_error", "front_back", "left_right", "leg_chamfer")


def lower_is_better(key: str) -> bool:
    """Whether a smaller value of a metric is the better one.

    >>> lower_is_better("chamfer_similarity"), lower_is_better("iou")
    (True, False)
    """
    return key.startswith(LOWER_IS_BETTER)


def definition(key: str) -> str | None:
    """Meaning of a key, of its plain form where it carries a suffix; ``None`` for keys unknown here."""
    known = [name for name in DEFINITIONS if key == name or key.startswith((f"{name}_", f"{name}@"))]
    return DEFINITIONS[max(known, key=len)] if known else None


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
