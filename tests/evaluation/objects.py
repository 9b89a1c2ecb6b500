"""Small hand-made predictions, samples and a predictions folder, without any model."""

import json
from pathlib import Path

import numpy as np

from fauna.evaluation.prediction import Prediction
from fauna.evaluation.reading import FACTS, FORMAT
from fauna.evaluation.records import pack_prediction, pack_sample
from fauna.evaluation.store import ArrayStore
from fauna.geometry.camera import make_camera
from fauna.metrics.sample import Sample

SIZE = 32
KEYPOINTS = ("nose", "left_eye", "right_eye", "tail")


def box_prediction(name: str, category: str, half: tuple[float, float, float], shift: float = 0.0) -> Prediction:
    """A box of the given half sizes seen from the front, and its exact silhouette at 32 pixels."""
    import torch

    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32) * np.float32(half)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)
    camera = make_camera(torch.eye(3)[None], torch.tensor([[shift, 0.0, 0.0]]), fov_deg=25.0, distance=10.0)
    clip = camera.clip_from_world[0].numpy()
    points = np.c_[corners, np.ones(8)] @ clip.T
    low, high = (points[:, :2] / points[:, 3:]).min(axis=0), (points[:, :2] / points[:, 3:]).max(axis=0)
    centre = (2 * np.arange(SIZE) + 1) / SIZE - 1
    inside = [(centre > low[axis]) & (centre < high[axis]) for axis in (0, 1)]
    return Prediction(
        name=name,
        category=category,
        verts=corners,
        canonical=corners.copy(),
        faces=faces,
        bone=np.full(8, -1, np.int32),
        local=corners.copy(),
        camera_from_world=camera.camera_from_world[0].numpy(),
        clip_from_world=clip,
        silhouette=((inside[1][:, None] & inside[0][None]) * 255).astype(np.uint8),
        probabilities=np.array([0.7, 0.1, 0.1, 0.1], np.float32),
        forwards=np.eye(3, dtype=np.float32)[[2, 0, 2, 0]],
        angles=np.zeros((0, 3), np.float32),
    )


def box_sample(prediction: Prediction, *, keypoints: bool = True, grow: int = 0) -> Sample:
    """The mask is the silhouette, or a wider one; keypoints lie on four corners of the box."""
    mask = prediction.silhouette > 127
    for _ in range(grow):
        mask = mask | np.roll(mask, 1, axis=1) | np.roll(mask, -1, axis=1)
    points = None
    if keypoints:
        clip = np.c_[prediction.verts[[1, 3, 5, 7]], np.ones(4)] @ prediction.clip_from_world.T
        points = np.c_[clip[:, :2] / clip[:, 3:], np.ones(4)].astype(np.float32)
    return Sample(prediction.name, prediction.category, mask, points, KEYPOINTS if keypoints else (), None)


def jpeg() -> bytes:
    """A grey picture."""
    import io

    from PIL import Image

    buffer = io.BytesIO()
    Image.new("RGB", (16, 16), (90, 120, 90)).save(buffer, format="JPEG")
    return buffer.getvalue()


def animals(*, grow: int = 0, keypoints: bool = True) -> tuple[list[Prediction], list[Sample]]:
    """Three boxes each of two species; ``grow`` makes every mask wider than the silhouette."""
    predictions = [
        box_prediction(f"{species}/{index}", species, (half + 0.1 * index, 0.6, 0.5), 0.1 * index)
        for species, half in (("long", 1.2), ("round", 0.7))
        for index in range(3)
    ]
    return predictions, [box_sample(p, keypoints=keypoints, grow=grow) for p in predictions]


def write_predictions(folder: Path, *, grow: int = 0, keypoints: bool = True, held_out: bool = False) -> Path:
    """A finished predictions folder of :func:`animals`; with ``held_out`` the round ones are held out."""
    predictions, samples = animals(grow=grow, keypoints=keypoints)
    stores = {name: ArrayStore(folder / name, identity={"test": 1}) for name in ("samples", "model", "mean_shape")}
    for prediction, sample in zip(predictions, samples, strict=True):
        stores["samples"].add(pack_sample(sample, thumbnail=jpeg()))
        stores["model"].add(pack_prediction(prediction, terms={"mask": 0.1, "iou": 0.8}))
        stores["mean_shape"].add(pack_prediction(prediction))
    for store in stores.values():
        store.flush()
    names = [prediction.name for prediction in predictions]
    seen = [name for name in names if not held_out or name.startswith("long")]
    groups = {"metrics": seen}
    if held_out:
        groups["held_out"] = [name for name in names if name not in seen]
    checkpoint = {"file": "weights.safetensors", "run": "boxes", "sha256": "0" * 64, "step": 3, "encoder": "none"}
    facts = {
        "format": FORMAT,
        "checkpoint": {**checkpoint, "species": ["long", "round"], "trained_on": {}, "config": {}},
        "dataset": {"identity": "boxes", "sha256": "1" * 64, "training_photos": {"included": 0, "unknown": None}},
        "size": SIZE,
        "keypoint_names": list(KEYPOINTS if keypoints else ()),
        "split": "test",
        "groups": groups,
        "settings": {"baselines": ["mean_shape"], "probes": [], "probed": []},
        "left_out": [{"of": "model", "name": "long/9", "metric": "all", "reason": "a broken file"}],
        "timing": {"model": 1.0},
    }
    (folder / FACTS).write_text(json.dumps(facts))
    return folder
