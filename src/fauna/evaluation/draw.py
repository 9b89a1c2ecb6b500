"""Pictures of a stored prediction; needs the rasteriser, not the model."""

import io

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from PIL import Image, ImageDraw
from torch.nn import functional as F

from fauna.evaluation.prediction import Prediction
from fauna.geometry.camera import to_clip
from fauna.geometry.mesh import vertex_normals
from fauna.io.contact_sheet import VIEWS
from fauna.metrics.sample import Sample
from fauna.renderer.numba_backend import NumbaRenderer

CELL = 160
"""Side of a picture, pixels."""
SUPERSAMPLE = 2
STEP_BACK = 1.15
"""Fixed views are taken from a little farther, so that long animals fit."""
MISSED, SPILLED, BOTH = (214, 69, 65), (246, 196, 68), (150, 190, 160)
CORRECT, WRONG = (34, 139, 80), (214, 40, 57)

Picture = UInt8[np.ndarray, "cell cell 3"]
RENDERER = NumbaRenderer()


def photograph(thumbnail: bytes) -> Picture:
    """The picture kept with the sample."""
    with Image.open(io.BytesIO(thumbnail)) as picture:
        return np.asarray(picture.convert("RGB").resize((CELL, CELL), Image.Resampling.LANCZOS))


def overlay(thumbnail: bytes, prediction: Prediction) -> Picture:
    """The shaded mesh over the photograph."""
    shade, covered = _shaded(prediction, prediction.camera_from_world, prediction.clip_from_world)
    tint = np.array([255.0, 150.0, 70.0]) * shade[..., None]
    share = 0.75 * covered[..., None]
    return (photograph(thumbnail) * (1 - share) + tint * share).round().astype(np.uint8)


def silhouettes(sample: Sample, prediction: Prediction) -> Picture:
    """Mask and silhouette: green where they agree, red where the mask is missed, yellow where the silhouette spills."""
    drawn = prediction.silhouette > 127
    assert sample.mask is not None, f"{sample.name} has no mask"
    mask = sample.mask
    picture = np.full((*drawn.shape, 3), 255, np.uint8)
    picture[mask & drawn], picture[mask & ~drawn], picture[drawn & ~mask] = BOTH, MISSED, SPILLED
    return np.asarray(Image.fromarray(picture).resize((CELL, CELL), Image.Resampling.BOX))


def side_view(prediction: Prediction) -> Picture:
    """The mesh from its side, head to the left if the model's +z is the head."""
    return fixed_view(prediction, np.array(VIEWS["side"]).T)


def fixed_view(prediction: Prediction, rotation: Float[np.ndarray, "3 3"]) -> Picture:
    """The shaded mesh on white from a given direction.

    Args:
        prediction: of a photograph.
        rotation: camera_from_world.
    """
    camera = prediction.camera_from_world.astype(np.float64)
    clip_from_camera = prediction.clip_from_world.astype(np.float64) @ np.linalg.inv(camera)
    view = np.eye(4)
    view[:3, :3] = rotation
    view[:3, 3] = -view[:3, :3] @ prediction.verts.mean(axis=0) + (0.0, 0.0, STEP_BACK * camera[2, 3])
    return _on_white(*_shaded(prediction, view, clip_from_camera @ view))


def as_seen(prediction: Prediction) -> Picture:
    """The shaded mesh on white from the predicted camera."""
    return _on_white(*_shaded(prediction, prediction.camera_from_world, prediction.clip_from_world))


def _on_white(shade: Float[np.ndarray, "cell cell"], covered: Float[np.ndarray, "cell cell"]) -> Picture:
    picture = np.where(covered[..., None] > 0, 255 * shade[..., None], 255).repeat(3, axis=2)
    return (picture * covered[..., None] + 255 * (1 - covered[..., None])).round().astype(np.uint8)


def keypoint_errors(
    thumbnail: bytes, truth: Float[np.ndarray, "key 3"], predicted: Float[np.ndarray, "key 2"], threshold: float
) -> Picture:
    """Annotated keypoints as rings, predicted ones as dots, joined by lines; green within the threshold.

    Args:
        thumbnail: of the photograph.
        truth: NDC and 1 where annotated.
        predicted: NDC, NaN where there is no prediction.
        threshold: largest error of a correct keypoint, crop sides.
    """
    pale = photograph(thumbnail).astype(np.float64) * 0.55 + 255 * 0.45
    picture = Image.fromarray(pale.round().astype(np.uint8))
    draw = ImageDraw.Draw(picture)
    for (x, y, flag), (u, v) in zip(truth, predicted, strict=True):
        if flag <= 0.5 or not np.isfinite([u, v]).all():
            continue
        ring, dot = _pixels(x, y), _pixels(float(u), float(v))
        colour = CORRECT if np.hypot(x - u, y - v) <= 2 * threshold else WRONG
        draw.line([ring, dot], fill=colour, width=1)
        draw.ellipse([ring[0] - 3, ring[1] - 3, ring[0] + 3, ring[1] + 3], outline=colour, width=1)
        draw.ellipse([dot[0] - 1.5, dot[1] - 1.5, dot[0] + 1.5, dot[1] + 1.5], fill=colour)
    return np.asarray(picture)


def blank() -> Picture:
    """A white cell, where there is nothing to draw."""
    return np.full((CELL, CELL, 3), 255, np.uint8)


def _pixels(x: float, y: float) -> tuple[float, float]:
    return (x + 1) / 2 * CELL, (y + 1) / 2 * CELL


@torch.no_grad()
def _shaded(
    prediction: Prediction, camera_from_world: np.ndarray, clip_from_world: np.ndarray
) -> tuple[Float[np.ndarray, "cell cell"], Float[np.ndarray, "cell cell"]]:
    """Headlight shading in [0, 1] and coverage."""
    if not len(prediction.faces) or not np.isfinite(prediction.verts).all():
        return np.ones((CELL, CELL)), np.zeros((CELL, CELL))
    verts = torch.from_numpy(prediction.verts)[None]
    faces = torch.from_numpy(prediction.faces).long()
    side = CELL * SUPERSAMPLE
    clip = to_clip(verts, torch.from_numpy(np.asarray(clip_from_world, np.float32))[None])
    fragments = RENDERER.rasterize(clip, faces, side, side)
    normals = vertex_normals(verts, faces) @ torch.from_numpy(np.asarray(camera_from_world[:3, :3], np.float32)).T
    facing = F.normalize(RENDERER.interpolate(fragments, faces, normals)[0], dim=0)
    light = (0.25 + 0.75 * (0.35 * facing[1] + 0.93 * facing[2]).abs()).clamp(0, 1)
    covered: Bool[torch.Tensor, "side side"] = fragments.covered[0]
    both = torch.stack([light * covered, covered.float()])
    total, share = F.avg_pool2d(both[None], SUPERSAMPLE)[0].double().numpy()
    return total / np.maximum(share, 1e-9), share
