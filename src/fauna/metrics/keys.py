"""The exact meaning of every key of a report; nowhere else is it written down."""

DEFINITIONS = {
    "iou": "intersection over union of the rendered silhouette and the mask, both thresholded at one half",
    "kt_pck@0.1": "keypoint transfer: source keypoint -> nearest visible vertex -> corresponding point of the target -> "
    "projected; share within 0.1 crop sides, over ordered pairs of one species where source and target are annotated",
    "kt_pck@0.1_lr_free": "the same, each pair free to swap left and right",
    "kt_pck@0.1_shared_base": "the same, each pair with one base mesh for the species (that of the mean shape code of its photographs) and "
    "corresponding points by vertex index; _lr_free likewise",
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

NEITHER = ("global_flip",)
"""Keys that state a fact about the model and are not to be maximised."""
LOWER_IS_BETTER = ("chamfer", "pa_mpjpe", "azimuth_error", "elevation_error", "front_back", "left_right", "leg_chamfer")


def lower_is_better(key: str) -> bool:
    """Whether a smaller value of a metric is the better one.

    >>> lower_is_better("chamfer_similarity"), lower_is_better("iou")
    (True, False)
    """
    return key.startswith(LOWER_IS_BETTER)


def better(key: str) -> str:
    """Which values of a metric are the better ones; empty where neither are.

    >>> better("iou"), better("chamfer"), better("global_flip")
    ('higher', 'lower', '')
    """
    if key in NEITHER:
        return ""
    return "lower" if lower_is_better(key) else "higher"


def definition(key: str) -> str | None:
    """Meaning of a key, of its plain form where it carries a suffix; ``None`` for keys unknown here."""
    known = [name for name in DEFINITIONS if key == name or key.startswith((f"{name}_", f"{name}@"))]
    return DEFINITIONS[max(known, key=len)] if known else None
