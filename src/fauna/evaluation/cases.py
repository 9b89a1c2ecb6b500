"""The best, a median and the worst photograph of each species, drawn for the report."""

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image

from fauna.errors import FaunaError
from fauna.evaluation import draw
from fauna.evaluation.prediction import Prediction
from fauna.metrics.sample import Sample, annotated
from fauna.metrics.transfer import THRESHOLD, transfer_canonical

RANKED_BY = ("iou", "kt_pck@0.1")
"""The first of them that a photograph of the species has; without any, photographs are drawn in the order of their names."""
RANKS = ("best", "median", "worst")
COLUMNS = ("photograph", "mesh", "silhouettes", "side", "keypoints")


@dataclass(frozen=True)
class DrawnCase:
    """One row of pictures.

    Attributes:
        species: of the photograph.
        name: of the photograph.
        rank: best, median or worst; ``unranked`` where nothing was scored.
        key: of the score it was ranked by, empty where there is none.
        score: that it was ranked by, ``None`` where there is none.
        source: photograph whose keypoints were transferred onto it, ``None`` without keypoints.
        png: base64 of a strip of :data:`COLUMNS`.
    """

    species: str
    name: str
    rank: str
    key: str
    score: float | None
    source: str | None
    png: str


def draw_cases(
    images: Mapping[str, Mapping[str, Any]],
    samples: Mapping[str, Sample],
    thumbnails: Mapping[str, bytes],
    predictions: Mapping[str, Prediction],
    *,
    species: int,
) -> list[DrawnCase]:
    """Rank the photographs of each species, by silhouette IoU where there are masks, and draw three of them.

    Args:
        images: scores by photograph, of one group.
        samples: by photograph.
        thumbnails: by photograph.
        predictions: of the model, by photograph.
        species: how many species are drawn, in alphabetical order.
    """
    by_species: dict[str, list[str]] = {}
    for name, row in sorted(images.items()):
        if name in predictions:
            by_species.setdefault(row["species"], []).append(name)
    drawn = []
    for each in sorted(by_species)[:species]:
        key, rows = _ranked(by_species[each], images)
        sources = [name for _, name in rows if samples[name].keypoints is not None]
        for rank, place in _chosen(len(rows), ranked=bool(key)):
            value, name = rows[place]
            source = next((other for other in sources if other != name), None)
            strip = _strip(name, source, samples, thumbnails, predictions)
            used = source if samples[name].keypoints is not None else None
            drawn.append(DrawnCase(each, name, rank, key, value, used, strip))
    return drawn


def _ranked(
    names: Sequence[str], images: Mapping[str, Mapping[str, Any]]
) -> tuple[str, list[tuple[float, str]] | list[tuple[None, str]]]:
    """The key that photographs are ranked by, and (score, name), best first; all of them, unranked, without any score."""
    for key in RANKED_BY:
        scores = [(images[name]["scores"].get(key), name) for name in names]
        known = [(float(score), name) for score, name in scores if score is not None]
        if known:
            return key, sorted(known, reverse=True)
    return "", [(None, name) for name in names]


def _chosen(number: int, *, ranked: bool) -> list[tuple[str, int]]:
    """Ranks and their places, each place once."""
    if not ranked:
        return [("unranked", place) for place in range(min(number, len(RANKS)))]
    places = (0, (number - 1) // 2, number - 1)
    return [
        (rank, place)
        for index, (rank, place) in enumerate(zip(RANKS, places, strict=True))
        if place not in places[:index]
    ]


def _strip(
    name: str,
    source: str | None,
    samples: Mapping[str, Sample],
    thumbnails: Mapping[str, bytes],
    predictions: Mapping[str, Prediction],
) -> str:
    prediction, sample = predictions[name], samples[name]
    cells = [
        draw.photograph(thumbnails[name]),
        draw.overlay(thumbnails[name], prediction),
        draw.blank() if sample.mask is None else draw.silhouettes(sample, prediction),
        draw.side_view(prediction),
        _keypoints(sample, thumbnails[name], [samples[s] for s in [source] if s], predictions),
    ]
    buffer = io.BytesIO()
    strip = Image.fromarray(np.concatenate(cells, axis=1))
    strip.quantize(192, dither=Image.Dither.NONE).save(buffer, format="PNG", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()


def _keypoints(
    sample: Sample, thumbnail: bytes, sources: Sequence[Sample], predictions: Mapping[str, Prediction]
) -> draw.Picture:
    """Keypoints of the best photograph of the species transferred onto this one."""
    if sample.keypoints is None or not sources:
        return draw.blank()
    both = [sources[0], sample]
    points = [annotated(each) for each in both]
    try:
        found = transfer_canonical([predictions[each.name] for each in both], points, np.array([[0, 1]]))[0]
    except (FaunaError, ValueError, IndexError):  # a mesh that cannot be scored cannot be drawn either
        return draw.blank()
    return draw.keypoint_errors(thumbnail, points[1], found, THRESHOLD)
