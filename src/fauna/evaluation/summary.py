"""Metrics of a model on photos reconstructed one by one, as at test time."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import torch

from fauna.losses.objective import Objective
from fauna.metrics.iou import silhouette_iou
from fauna.model import FaunaModel
from fauna.types import Batch, Reconstruction


@torch.no_grad()
def evaluate(model: FaunaModel, objective: Objective, photos: Iterable[tuple[str, Batch]]) -> dict[str, Any] | None:
    """Silhouette IoU and image losses per species; overall is the mean over species.

    Args:
        model: put into eval mode for the purpose.
        objective: whose image terms are reported, unweighted.
        photos: (species, batch of one photo).

    Returns:
        ``iou``, ``losses``, ``num_photos`` and the same per species under ``species``; ``None`` without photos.
    """
    training = model.training
    model.eval()
    rows: dict[str, list[dict[str, float]]] = defaultdict(list)
    for species, photo in photos:
        photo = model.with_features(photo.to(model.device))
        rows[species].append(image_terms(model, objective, photo, model(photo)))
    model.train(training)
    return table(rows)


@torch.no_grad()
def image_terms(model: FaunaModel, objective: Objective, photo: Batch, out: Reconstruction) -> dict[str, float]:
    """Unweighted losses and silhouette ``iou`` of one photo, at the resolution of its batch."""
    losses = objective(photo, model.feature_targets(photo), out, model.stage, {})
    row = {name: float(value) for name, value in losses.terms.items()}
    return {**row, "iou": float(silhouette_iou(out.renders.silhouette, photo.masks)[0])}


def table(rows: Mapping[str, Sequence[Mapping[str, float]]]) -> dict[str, Any] | None:
    """Means of each species and over species; ``None`` without rows.

    Args:
        rows: by species, of :func:`image_terms`.
    """
    if not rows:
        return None
    by_species = {species: _summary(of_species) for species, of_species in sorted(rows.items())}
    overall = _summary([{"iou": each["iou"], **each["losses"]} for each in by_species.values()])
    return {**overall, "num_photos": sum(map(len, rows.values())), "species": by_species}


def _summary(rows: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    means = {name: sum(row[name] for row in rows) / len(rows) for name in rows[0]}
    return {"iou": means.pop("iou"), "num_photos": len(rows), "losses": means}
