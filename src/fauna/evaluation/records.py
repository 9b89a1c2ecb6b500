"""Predictions and samples as bundles of arrays, and back."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from fauna.data.truth import Truth3D
from fauna.evaluation.prediction import Prediction
from fauna.evaluation.store import Item
from fauna.metrics.sample import Sample

TRUTH = "truth."


def pack_prediction(prediction: Prediction, **notes: object) -> Item:
    """All fields; ``notes`` must fit into JSON."""
    arrays = {f.name: getattr(prediction, f.name) for f in fields(Prediction) if f.name not in ("name", "category")}
    return Item(prediction.name, arrays, {"category": prediction.category, **notes})


def unpack_prediction(item: Item) -> Prediction:
    """The prediction of a bundle; further arrays are left alone."""
    names = [f.name for f in fields(Prediction) if f.name not in ("name", "category")]
    return Prediction(name=item.name, category=item.notes["category"], **{name: item.arrays[name] for name in names})


def pack_sample(sample: Sample, *, thumbnail: bytes, **more: object) -> Item:
    """Mask (one bit a pixel), keypoints and truth of a photograph, a small JPEG of it for the report, and further notes."""
    arrays: dict[str, np.ndarray] = {"thumbnail": np.frombuffer(thumbnail, np.uint8)}
    notes: dict[str, object] = {"category": sample.category, **more}
    if sample.mask is not None:
        arrays["mask"] = np.packbits(sample.mask)
        notes["size"] = sample.mask.shape[0]
    if sample.keypoints is not None:
        arrays["keypoints"] = sample.keypoints.astype(np.float32)
    if sample.truth is not None:
        arrays |= {TRUTH + f.name: _narrow(np.asarray(getattr(sample.truth, f.name))) for f in fields(Truth3D)}
    return Item(sample.name, arrays, notes)


def unpack_sample(item: Item, keypoint_names: Sequence[str]) -> Sample:
    """The sample of a bundle."""
    mask = truth = None
    if "mask" in item.arrays:
        size = item.notes["size"]
        mask = np.unpackbits(item.arrays["mask"], count=size * size).reshape(size, size).astype(bool)
    if any(name.startswith(TRUTH) for name in item.arrays):
        values: dict[str, Any] = {f.name: item.arrays[TRUTH + f.name] for f in fields(Truth3D)}
        values |= {name: float(values[name]) for name in ("azimuth_deg", "elevation_deg")}
        truth = Truth3D(**values)
    keypoints = item.arrays.get("keypoints")
    return Sample(item.name, item.notes["category"], mask, keypoints, tuple(keypoint_names), truth)


def _narrow(array: np.ndarray) -> np.ndarray:
    """32 bits are enough for what is stored."""
    return array.astype({"f": np.float32, "i": np.int32}.get(array.dtype.kind, array.dtype))
