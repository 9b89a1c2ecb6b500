"""Metrics of annotated keypoints: transfer between photos, and the fitted map from surface to keypoints."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from fauna.errors import FaunaError
from fauna.evaluation.prediction import Prediction
from fauna.metrics.alignment import pa_mpjpe
from fauna.metrics.keypoint_map import REFERENCE_POINTS, in_fit_half, map_keypoints, reference_places, resample
from fauna.metrics.outcome import Options, Outcome, reasons_to_rows
from fauna.metrics.pairs import mirror_map, ordered_pairs
from fauna.metrics.sample import Case, LeftOut, annotated
from fauna.metrics.tally import Tally, image_tally
from fauna.metrics.transfer import (
    NDC_PER_CROP,
    THRESHOLD,
    check_shared_base,
    transfer_canonical,
    transfer_shared_base,
    transfer_tallies,
)
from fauna.metrics.visibility import to_ndc

KT_KEY, KT_LR_FREE = "kt_pck@0.1", "kt_pck@0.1_lr_free"
PCK_KEY, PCK_ON_TEST = "pck@0.1", "pck@0.1_fit_on_test"
PA_KEY = "pa_mpjpe"
LEAST_KEYPOINTS = 4
"""Fewer are fitted too easily by a similarity."""

PairTransfer = Callable[[Int[np.ndarray, "pair 2"]], Float[np.ndarray, "pair key 2"]]


def transfer_metric(cases: Sequence[Case], options: Options) -> Outcome:
    """``kt_pck@0.1`` and ``..._lr_free`` by canonical lookup, and with the setting ``shared_base`` both by vertex index."""
    own = _transferred(cases, options, [case.prediction for case in cases], [case.fault for case in cases], "")
    if "shared_base" not in options.settings:
        return own
    shared = [case.shared for case in cases]
    faults = _unequal(shared, [case.shared_fault for case in cases])
    other = _transferred(cases, options, shared, faults, "_shared_base")
    return Outcome({**own.tallies, **other.tallies}, [*own.left_out, *other.left_out])


def _transferred(
    cases: Sequence[Case],
    options: Options,
    predictions: Sequence[Prediction | None],
    faults: Sequence[str | None],
    suffix: str,
) -> Outcome:
    """Keypoint transfer between predictions; by vertex index where the keys have a suffix."""
    method = transfer_shared_base if suffix else transfer_canonical
    usable = np.array([fault is None for fault in faults])
    meshes = [each for each, fault in zip(predictions, faults, strict=True) if fault is None and each is not None]
    points = [annotated(case.sample) for case, fault in zip(cases, faults, strict=True) if fault is None]
    place = np.cumsum(usable) - 1
    return pair_outcome(cases, options, faults, lambda pairs: method(meshes, points, place[pairs]), suffix)


def _unequal(predictions: Sequence[Prediction | None], faults: Sequence[str | None]) -> list[str | None]:
    """Faults, and for all of a species that its meshes have different triangles."""
    usable = [each for each, fault in zip(predictions, faults, strict=True) if fault is None and each is not None]
    try:
        check_shared_base(usable)
    except FaunaError:
        return [fault or "its species shares no base mesh" for fault in faults]
    return list(faults)


def pair_outcome(
    cases: Sequence[Case], options: Options, faults: Sequence[str | None], transfer: PairTransfer, suffix: str
) -> Outcome:
    """Judge a transfer on the pairs of a species.

    The pairs depend on the annotations only, so all methods are asked for the same ones; those with a faulty photo are left out.

    Args:
        cases: of one species.
        options: number and seed of the pairs.
        faults: why a photo cannot be used, by case.
        transfer: predicted positions for pairs of case indices.
        suffix: of the keys.
    """
    names = cases[0].sample.keypoint_names
    keypoints = np.stack([annotated(case.sample) for case in cases])
    chosen = np.flatnonzero(keypoints[..., 2].any(axis=1))
    drawn = chosen[
        ordered_pairs([cases[i].sample.name for i in chosen.tolist()], count=options.pairs, seed=options.seed)
    ]
    usable = np.array([fault is None for fault in faults])
    pairs = drawn[usable[drawn].all(axis=1)]
    predicted = transfer(pairs) if len(pairs) else np.zeros((0, len(names), 2))
    plain, lr_free = transfer_tallies(predicted, keypoints, pairs, mirror_map(names), names)
    counted = np.unique(pairs[plain.counts.any(axis=1)])
    reasons = [
        None if i in set(counted.tolist()) else _pair_reason(i, keypoints, faults, drawn) for i in range(len(cases))
    ]
    keys = [key.replace("@0.1", f"@0.1{suffix}") for key in (KT_KEY, KT_LR_FREE)]
    rows = [row for key in keys for row in reasons_to_rows(cases, key, reasons)]
    return Outcome(dict(zip(keys, (plain, lr_free), strict=True)), rows)


def map_metric(cases: Sequence[Case], options: Options) -> Outcome:
    """``pck@0.1``: keypoints by a map fitted on one half of the photos, on the other half; ``pa_mpjpe`` of the same in 3D.

    With the setting ``fit_on_test`` also ``pck@0.1_fit_on_test``: fitted and tested on all photos, as the paper seems to do.
    """
    keypoints = np.stack([annotated(case.sample) for case in cases])
    shown: np.ndarray = keypoints[..., 2].max(axis=1, initial=0.0) > 0
    usable = shown & np.array([case.fault is None for case in cases])
    fit = np.zeros(len(cases), bool)
    fit[shown] = in_fit_half([cases[i].sample.name for i in np.flatnonzero(shown).tolist()], seed=options.seed)
    positions = _positions(cases, usable, fit & usable)
    found = _mapped(cases, keypoints, usable, fit & usable, positions)
    test = usable & ~fit
    reasons: list[str | None] = [
        _map_reason(case, s, f, bool((fit & usable).any()))
        for case, s, f in zip(cases, shown.tolist(), fit.tolist(), strict=True)
    ]
    tallies = {PCK_KEY: _map_tally(cases, keypoints, found, test)}
    left_out = _uncounted(cases, PCK_KEY, tallies[PCK_KEY], reasons)
    rows = [reason or _pa_value(case, points) for case, reason, points in zip(cases, reasons, found, strict=True)]
    tallies[PA_KEY] = image_tally([None if isinstance(row, str) else row for row in rows])
    left_out += reasons_to_rows(cases, PA_KEY, [row if isinstance(row, str) else None for row in rows])
    if "fit_on_test" in options.settings:
        everywhere = _mapped(cases, keypoints, usable, usable, positions)
        tallies[PCK_ON_TEST] = _map_tally(cases, keypoints, everywhere, usable)
        whole = [_map_reason(case, s, False, True) for case, s in zip(cases, shown.tolist(), strict=True)]
        left_out += _uncounted(cases, PCK_ON_TEST, tallies[PCK_ON_TEST], whole)
    return Outcome(tallies, left_out)


def _positions(
    cases: Sequence[Case], usable: Bool[np.ndarray, " image"], fit: Bool[np.ndarray, " image"]
) -> Float[np.ndarray, "usable point 3"]:
    """Posed reference points of every usable photo; the reference is the first mesh that the map is fitted on, or the first at all."""
    chosen = np.flatnonzero(fit if fit.any() else usable)
    if not len(chosen):
        return np.zeros((0, 0, 3))
    reference = reference_places(cases[int(chosen[0])].mesh, count=REFERENCE_POINTS)
    return resample([case.mesh for case, use in zip(cases, usable.tolist(), strict=True) if use], reference)


def _mapped(
    cases: Sequence[Case],
    keypoints: Float[np.ndarray, "image key 3"],
    usable: Bool[np.ndarray, " image"],
    fit: Bool[np.ndarray, " image"],
    positions: Float[np.ndarray, "usable point 3"],
) -> Float[np.ndarray, "image key 3"]:
    """3D keypoints of every usable photo, NaN elsewhere and for what cannot be fitted."""
    found = np.full(keypoints.shape, np.nan)
    if fit.any():
        meshes = [case.mesh for case, use in zip(cases, usable.tolist(), strict=True) if use]
        found[usable] = map_keypoints(meshes, keypoints[usable], fit[usable], positions)
    return found


def _map_tally(
    cases: Sequence[Case],
    keypoints: Float[np.ndarray, "image key 3"],
    found: Float[np.ndarray, "image key 3"],
    test: Bool[np.ndarray, " image"],
) -> Tally:
    counts = (keypoints[..., 2] > 0) & test[:, None] & np.isfinite(found).all(axis=2)
    correct = np.zeros(counts.shape, bool)
    for i in np.flatnonzero(test).tolist():
        error = np.linalg.norm(to_ndc(cases[i].mesh.clip_from_world, found[i]) - keypoints[i, :, :2], axis=1)
        correct[i] = error <= THRESHOLD * NDC_PER_CROP  # False for NaN
    owners = np.arange(len(cases))[:, None]
    names = cases[0].sample.keypoint_names
    return Tally(owners, (correct & counts).astype(np.float64), counts.astype(np.float64), names)


def _pa_value(case: Case, found: Float[np.ndarray, "key 3"]) -> float | str:
    """Share of the truth's size, or why there is none."""
    truth = case.sample.truth
    if truth is None:
        return "no truth"
    known = np.isfinite(found).all(axis=1) & np.isfinite(truth.keypoints).all(axis=1)
    if known.sum() < LEAST_KEYPOINTS:
        return f"fewer than {LEAST_KEYPOINTS} keypoints with truth and fit"
    size = float(np.linalg.norm(np.ptp(truth.verts, axis=0)))
    return pa_mpjpe(found[known], truth.keypoints[known].astype(np.float64)) / size


def _uncounted(cases: Sequence[Case], key: str, tally: Tally, reasons: Sequence[str | None]) -> list[LeftOut]:
    counted = tally.counts.max(axis=1, initial=0.0) > 0
    rows = [
        None if seen else reason or "none of its keypoints is seen where the map is fitted"
        for seen, reason in zip(counted.tolist(), reasons, strict=True)
    ]
    return reasons_to_rows(cases, key, rows)


def _map_reason(case: Case, shown: bool, fits: bool, fitted: bool) -> str | None:
    if not shown:
        return "no keypoints"
    if case.fault is not None:
        return case.fault
    if fits:
        return "the keypoint map is fitted on it"
    return None if fitted else "no photo to fit the keypoint map on"


def _pair_reason(
    image: int,
    keypoints: Float[np.ndarray, "image key 3"],
    faults: Sequence[str | None],
    drawn: Int[np.ndarray, "pair 2"],
) -> str:
    fault = faults[image]
    if not keypoints[image, :, 2].any():
        return "no keypoints"
    if fault is not None:
        return fault
    if keypoints[..., 2].any(axis=1).sum() < 2:
        return "only photo of its species with keypoints"
    if not (drawn == image).any():
        return "in none of the drawn pairs"
    return "no keypoint annotated in both photos of a pair"
