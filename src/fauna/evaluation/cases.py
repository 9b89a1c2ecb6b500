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

RANKED_BY = "iou"
COLUMNS = ("photograph", "mesh", "silhouettes", "side", "keypoints")


@dataclass(frozen=True)
class DrawnCase:
    """One row of pictures.

    Attributes:
        species: of the photograph.
        name: of the photograph.
        rank: best, median or worst.
        score: that it was ranked by.
        source: photograph whose keypoints were transferred onto it, ``None`` without keypoints.
        png: base64 of a strip of :data:`COLUMNS`.
    """

    species: str
    name: str
    rank: str
    score: float
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
    """Rank the photographs of each species by silhouette IoU and draw three of them.

    Args:
        images: scores by photograph, of one group.
        samples: by photograph.
        thumbnails: by photograph.
        predictions: of the model, by photograph.
        species: how many species are drawn, in alphabetical order.
    """
    ranked: dict[str, list[tuple[float, str]]] = {}
    for name, row in images.items():
        value = row["scores"].get(RANKED_BY)
        if value is not None and name in predictions:
            ranked.setdefault(row["species"], []).append((value, name))
    drawn = []
    for each in sorted(ranked)[:species]:
        rows = sorted(ranked[each], reverse=True)
        places = {"best": 0, "median": (len(rows) - 1) // 2, "worst": len(rows) - 1}
        chosen = {
            rank: place
            for rank, place in places.items()
            if list(places.values()).index(place) == list(places).index(rank)
        }
        sources = [name for _, name in rows if samples[name].keypoints is not None]
        for rank, place in chosen.items():
            value, name = rows[place]
            source = next((other for other in sources if other != name), None)
            strip = _strip(name, source, samples, thumbnails, predictions)
            used = source if samples[name].keypoints is not None else None
            drawn.append(DrawnCase(each, name, rank, value, used, strip))
    return drawn


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
        draw.silhouettes(sample, prediction),
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
