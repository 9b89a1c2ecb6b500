"""Metrics against known geometry: surface, volume, legs, unseen views and viewpoint."""

from collections.abc import Mapping, Sequence

import numpy as np

from fauna.data.truth import LEGS
from fauna.geometry.skeleton import BONES_PER_LEG, NUM_BODY_BONES
from fauna.metrics.alignment import ICP_POINTS, Aligned, align_camera, align_similarity
from fauna.metrics.camera import crop_camera, front_back_flip, left_right_flip, viewpoint, wrap_degrees
from fauna.metrics.novel_view import novel_view_iou
from fauna.metrics.outcome import Options, Outcome, per_image
from fauna.metrics.sample import Case
from fauna.metrics.surface import F_THRESHOLD, Mesh, chamfer_and_f_score, face_areas, surface_points, volume_iou
from fauna.random import derive_seed

POINTS = 2000
"""Points drawn on each surface."""
LEG_POINTS = 500
"""Points drawn on each leg."""
SKELETON_LEG = (0, 3, 1, 2)
"""Leg of the skeleton (docs/conventions.md) for each of :data:`fauna.data.truth.LEGS`."""
VIEWPOINT_KEYS = (
    "azimuth_error_deg",
    "azimuth_within_30",
    "elevation_error_deg",
    "front_back_flips",
    "left_right_flips",
)
CAMERA_KEYS = ("chamfer", "f_score", "volume_iou", "novel_view_iou", "leg_chamfer")
SIMILARITY_KEYS = ("chamfer_similarity", "f_score_similarity", "volume_iou_similarity")


def global_flip(cases: Mapping[str, Sequence[Case]]) -> bool | None:
    """Whether all predictions are to be turned about the vertical by half a turn: the model's +z is the tail everywhere.

    True if that raises the mean cosine of the azimuth error (mean over species); ``None`` where nothing has a truth.
    """
    means = []
    for of_species in cases.values():
        pairs = [_viewpoints(case, flip=False) for case in of_species if _fault(case) is None]
        if pairs:
            means.append(np.mean([np.cos(np.radians(predicted[0] - true[0])) for predicted, true in pairs]))
    return bool(np.mean(means) < 0) if means else None


def viewpoint_metric(cases: Sequence[Case], options: Options) -> Outcome:
    """Errors of azimuth and elevation in degrees, and the shares of photos within 30 degrees and of flips.

    Both viewpoints are those of the crop cameras: the angles that ``Truth3D`` records belong to the optical axis of the whole photo,
    which a crop does not tell (a perfect model would be off by 2.7 degrees on the zoo).
    """

    def measure(case: Case) -> dict[str, float | str]:
        fault = _fault(case)
        if fault is not None:
            return dict.fromkeys(VIEWPOINT_KEYS, fault)
        (azimuth, elevation), (true_azimuth, true_elevation) = _viewpoints(case, options.flip)
        error = abs(wrap_degrees(azimuth - true_azimuth))
        values = (
            error,
            float(error <= 30),
            abs(elevation - true_elevation),
            float(front_back_flip(azimuth, true_azimuth)),
            float(left_right_flip(azimuth, true_azimuth)),
        )
        return dict(zip(VIEWPOINT_KEYS, values, strict=True))

    return per_image(cases, VIEWPOINT_KEYS, measure)


def surface_metric(cases: Sequence[Case], options: Options) -> Outcome:
    """Chamfer distance, F-score, volume IoU, IoU from unseen views and the legs' own Chamfer distance.

    Distances are shares of the diagonal of the truth's bounding box. Plain keys: aligned in the camera frame; with the setting
    ``similarity`` also after a rigid alignment with scale.
    """
    similarity = "similarity" in options.settings
    keys = CAMERA_KEYS + (SIMILARITY_KEYS if similarity else ())

    def measure(case: Case) -> dict[str, float | str]:
        fault = _fault(case) or _degenerate(case)
        if fault is not None:
            return dict.fromkeys(keys, fault)
        assert case.sample.truth is not None
        seed = derive_seed(options.seed, "surface", case.sample.name)
        aligned = align_camera(case.mesh, case.sample.truth)
        values: dict[str, float | str] = {
            **_compare(aligned, seed, ""),
            "novel_view_iou": novel_view_iou(aligned),
            "leg_chamfer": leg_chamfer(case, aligned, seed=seed, flip=options.flip),
        }
        if similarity:
            points = [
                surface_points(mesh, count=ICP_POINTS, rng=np.random.default_rng(seed))
                for mesh in (aligned.predicted, aligned.true)
            ]
            values |= _compare(align_similarity(aligned, *points), seed, "_similarity")
        return values

    return per_image(cases, keys, measure)


def leg_chamfer(case: Case, aligned: Aligned, *, seed: int, flip: bool) -> float | str:
    """Mean over the truth's legs of the Chamfer distance to the predicted surface whose bones are those of that leg.

    Returns:
        A share of the truth's size, or why there is none: a leg without a predicted surface is not passed over.
    """
    truth, prediction = case.sample.truth, case.mesh
    assert truth is not None
    if (prediction.bone < 0).all():
        return "prediction has no bones"
    predicted_leg = (prediction.bone.astype(np.int64) - NUM_BODY_BONES) // BONES_PER_LEG
    found = []
    for leg, name in enumerate(LEGS):
        true = _part(aligned.true, truth.legs == leg)
        if true is None:
            continue
        wanted = (SKELETON_LEG[leg] + (2 if flip else 0)) % 4
        predicted = _part(aligned.predicted, predicted_leg == wanted)
        if predicted is None:
            return f"prediction has no surface of the {name} leg"
        rng = np.random.default_rng(derive_seed(seed, name))
        chamfer, _ = chamfer_and_f_score(predicted, true, threshold=0.0, count=LEG_POINTS, rng=rng)
        found.append(chamfer / aligned.size)
    return float(np.mean(found)) if found else "truth has no legs"


def _compare(aligned: Aligned, seed: int, suffix: str) -> dict[str, float]:
    chamfer, f_score = chamfer_and_f_score(
        aligned.predicted,
        aligned.true,
        threshold=F_THRESHOLD * aligned.size,
        count=POINTS,
        rng=np.random.default_rng(seed),
    )
    return {
        f"chamfer{suffix}": chamfer / aligned.size,
        f"f_score{suffix}": f_score,
        f"volume_iou{suffix}": volume_iou(aligned.predicted, aligned.true),
    }


def _part(mesh: Mesh, chosen: np.ndarray) -> Mesh | None:
    """The triangles whose corners are all chosen; ``None`` if they have no area."""
    a, b, c = chosen[mesh.faces].T
    part = Mesh(mesh.verts, mesh.faces[a & b & c])
    return part if len(part.faces) and face_areas(part).sum() > 0 else None


def _viewpoints(case: Case, flip: bool) -> tuple[tuple[float, float], tuple[float, float]]:
    """Azimuth and elevation of the predicted and of the true crop camera."""
    truth, prediction = case.sample.truth, case.mesh
    assert truth is not None
    azimuth, elevation = viewpoint(crop_camera(prediction.camera_from_world, prediction.clip_from_world)[0])
    true = viewpoint(crop_camera(truth.camera_from_world, truth.clip_from_world)[0])
    return (azimuth + (180.0 if flip else 0.0), elevation), true


def _fault(case: Case) -> str | None:
    return "no truth" if case.sample.truth is None else case.fault


def _degenerate(case: Case) -> str | None:
    """Why two surfaces cannot be compared although all numbers are finite."""
    truth, prediction = case.sample.truth, case.mesh
    assert truth is not None
    if not len(truth.faces) or not np.isfinite(truth.verts).all():
        return "truth has no surface"
    if face_areas(Mesh(prediction.verts, prediction.faces)).sum() <= 0:
        return "prediction has no area"
    w = prediction.clip_from_world[3].astype(np.float64)
    if (prediction.verts @ w[:3] + w[3] <= 0).any():
        return "prediction reaches behind the camera"
    return None
