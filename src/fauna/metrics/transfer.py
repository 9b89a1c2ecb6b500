"""Keypoint transfer between photos of a species (Sec. 5.3, KT-PCK; A-CSM's protocol).

A keypoint of the source photo is carried to its nearest visible vertex, from there to the corresponding point of the target's
surface, and from there into the target photo. It is correct within a tenth of the crop's side.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from fauna.errors import FaunaError
from fauna.evaluation.prediction import Prediction
from fauna.metrics.lookup import Places, SurfaceIndex, vertex_places
from fauna.metrics.tally import Tally
from fauna.metrics.visibility import keypoint_vertices, to_ndc

THRESHOLD = 0.1
"""Largest error of a correct keypoint, crop sides."""
NDC_PER_CROP = 2.0

Transfer = Callable[[int, int], Float[np.ndarray, "key 2"]]
"""From the indices of source and target to where each of the source's keypoints is predicted in the target, NDC; NaN for no answer."""


def transfer_canonical(
    predictions: Sequence[Prediction], keypoints: Sequence[Float[np.ndarray, "key 3"]], pairs: Int[np.ndarray, "pair 2"]
) -> Float[np.ndarray, "pair key 2"]:
    """Transfer by bone-local coordinates, see :mod:`fauna.metrics.lookup`; the surfaces may differ in every respect.

    Args:
        predictions: of the photos.
        keypoints: of the photos: NDC x, y and 1 where annotated.
        pairs: (source, target) indices of photos.

    Returns:
        NDC positions in the target; NaN where the source has no such keypoint.
    """
    number = len(keypoints[0]) if len(keypoints) else 0
    vertices = [keypoint_vertices(p, points) for p, points in zip(predictions, keypoints, strict=True)]
    places = [vertex_places(p).rows(np.maximum(v, 0)) for p, v in zip(predictions, vertices, strict=True)]
    predicted = np.full((len(pairs), number, 2), np.nan)
    for target in np.unique(pairs[:, 1]):
        rows = np.flatnonzero(pairs[:, 1] == target)
        source, key = np.nonzero(np.stack([vertices[i] >= 0 for i in pairs[rows, 0]]))
        wanted = _stack([places[i] for i in pairs[rows, 0]]).rows(source * number + key)
        corners, weights = SurfaceIndex.of(predictions[target]).find(wanted)
        points = (predictions[target].verts[corners] * weights[..., None]).sum(axis=1)
        predicted[rows[source], key] = to_ndc(predictions[target].clip_from_world, points)
    return predicted


def transfer_shared_base(
    predictions: Sequence[Prediction], keypoints: Sequence[Float[np.ndarray, "key 3"]], pairs: Int[np.ndarray, "pair 2"]
) -> Float[np.ndarray, "pair key 2"]:
    """Transfer by vertex index, for predictions that deform one base mesh; see :func:`transfer_canonical`.

    Raises:
        FaunaError: the predictions have different triangles.
    """
    check_shared_base(predictions)
    vertices = [keypoint_vertices(p, points) for p, points in zip(predictions, keypoints, strict=True)]
    ndc = [to_ndc(p.clip_from_world, p.verts) for p in predictions]
    number = len(keypoints[0]) if len(keypoints) else 0
    predicted = np.full((len(pairs), number, 2), np.nan)
    for row, (source, target) in enumerate(pairs):
        known = vertices[source] >= 0
        predicted[row, known] = ndc[target][vertices[source][known]]
    return predicted


def check_shared_base(predictions: Sequence[Prediction]) -> None:
    """Require equal triangles.

    Raises:
        FaunaError: naming the first prediction that differs.
    """
    for prediction in predictions[1:]:
        first = predictions[0]
        if len(prediction.verts) != len(first.verts) or not np.array_equal(prediction.faces, first.faces):
            raise FaunaError(
                f"shared_base: expected one base mesh for {first.category}, got {len(first.verts)} vertices in {first.name} and "
                f"{len(prediction.verts)} in {prediction.name}; predict with one shape code per species or leave shared_base out"
            )


def transfer_by_function(
    transfer: Transfer, number: int, pairs: Int[np.ndarray, "pair 2"]
) -> Float[np.ndarray, "pair key 2"]:
    """Ask any method for every pair."""
    rows = [transfer(int(source), int(target)) for source, target in pairs]
    return np.stack(rows).astype(np.float64) if rows else np.zeros((0, number, 2))


def judge(
    predicted: Float[np.ndarray, "pair key 2"],
    keypoints: Float[np.ndarray, "image key 3"],
    pairs: Int[np.ndarray, "pair 2"],
    mirror: Int[np.ndarray, " key"],
) -> tuple[Bool[np.ndarray, "pair key"], Bool[np.ndarray, "pair key"], Bool[np.ndarray, "pair key"]]:
    """Which transferred keypoints count, which are correct, and which are when swaps of left and right are forgiven.

    A keypoint counts if it is annotated in both photos. The swap is forgiven pair by pair: each keypoint is also judged against
    the target's keypoint of the other side (a miss where that is not annotated), and whichever naming has more correct keypoints
    holds for the whole pair, the given one at equality. What counts is the same under both.

    Args:
        predicted: NDC; NaN is a miss.
        keypoints: NDC x, y and 1 where annotated.
        pairs: (source, target) indices of images.
        mirror: see :func:`fauna.metrics.pairs.mirror_map`.

    Returns:
        ``counted``, ``correct``, ``correct_lr_free``.
    """
    source, target = keypoints[pairs[:, 0]], keypoints[pairs[:, 1]]
    counted = (source[..., 2] > 0) & (target[..., 2] > 0)
    own = counted & _near(predicted, target)
    other = counted & _near(predicted, target[:, mirror]) & (target[:, mirror, 2] > 0)
    swapped = other.sum(axis=1) > own.sum(axis=1)
    return counted, own, np.where(swapped[:, None], other, own)


def transfer_tallies(
    predicted: Float[np.ndarray, "pair key 2"],
    keypoints: Float[np.ndarray, "image key 3"],
    pairs: Int[np.ndarray, "pair 2"],
    mirror: Int[np.ndarray, " key"],
    names: tuple[str, ...],
) -> tuple[Tally, Tally]:
    """Tallies of ``kt_pck@0.1`` and ``kt_pck@0.1_lr_free``; arguments as in :func:`judge`."""
    counted, correct, correct_lr_free = judge(predicted, keypoints, pairs, mirror)
    counts = counted.astype(np.float64)
    return (
        Tally(pairs, correct.astype(np.float64), counts, names),
        Tally(pairs, correct_lr_free.astype(np.float64), counts, names),
    )


def _near(predicted: Float[np.ndarray, "pair key 2"], target: Float[np.ndarray, "pair key 3"]) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return np.linalg.norm(predicted - target[..., :2], axis=-1) <= THRESHOLD * NDC_PER_CROP


def _stack(places: Sequence[Places]) -> Places:
    return Places(*(np.concatenate([getattr(each, name) for each in places]) for name in Places.__dataclass_fields__))
