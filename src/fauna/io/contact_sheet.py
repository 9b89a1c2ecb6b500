"""Contact sheets: what the model sees and what it makes of it, one row per photo."""

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image, ImageDraw
from torch import Tensor
from torch.nn import functional as F

from fauna.geometry.camera import make_camera, to_clip
from fauna.geometry.mesh import vertex_normals
from fauna.losses.reconstruction import upsample
from fauna.model import FaunaModel
from fauna.types import Batch, PosedMesh, Reconstruction

COLUMNS = ("photo", "mask", "features", "silhouette", "colour", "rendered features", "shape", "side", "behind", "above")
VIEWS = {
    "side": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)),
    "behind": ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    "above": ((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
}
"""Columns (right, up, forward) of the camera_from_world rotations of the fixed views."""


@torch.no_grad()
def contact_sheet(model: FaunaModel, photos: list[Batch], cell: int) -> Image.Image:
    """Reconstruct each photo on its own and lay out :data:`COLUMNS`.

    Args:
        model: in any stage; put into eval mode for the purpose.
        photos: batches of one photo.
        cell: side of a picture, pixels.
    """
    training = model.training
    model.eval()
    rows = [_row(model, photo, cell) for photo in photos]
    model.train(training)
    sheet = Image.fromarray(np.concatenate(rows, axis=0))
    return _with_captions(sheet, cell)


def save_png(image: Image.Image, path: Path) -> None:
    """Write a PNG atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    image.save(partial, format="PNG")
    partial.replace(path)


def shape_view(
    model: FaunaModel, posed: PosedMesh, view: str, cell: int, camera_rotation: Tensor | None = None
) -> Float[Tensor, "3 height width"]:
    """Grey headlight rendering of the first row's mesh from a named view, or with a given rotation."""
    rotation = (torch.tensor(VIEWS[view]).T[None] if camera_rotation is None else camera_rotation[None]).to(posed.verts)
    distance = model.camera["distance"] * 1.15
    camera = make_camera(rotation, rotation.new_zeros(1, 3), fov_deg=model.camera["fov_deg"], distance=distance)
    verts = posed.verts[:1] - posed.verts[:1].mean(dim=1, keepdim=True)
    fragments = model.renderer.rasterize(to_clip(verts, camera.clip_from_world), posed.faces, 2 * cell, 2 * cell)
    normals = vertex_normals(verts, posed.faces) @ camera.camera_from_world[:, :3, :3].transpose(1, 2)
    facing = F.normalize(model.renderer.interpolate(fragments, posed.faces, normals)[0], dim=0)
    light = (0.25 + 0.75 * (0.35 * facing[1] + 0.93 * facing[2]).abs()).clamp(0, 1)
    grey = torch.where(fragments.covered[0], light, torch.ones_like(light))
    return F.avg_pool2d(grey[None, None], 2)[0].expand(3, -1, -1)


def _row(model: FaunaModel, photo: Batch, cell: int) -> np.ndarray:
    photo = model.with_features(photo.to(model.device))
    out: Reconstruction = model(photo)
    renders = out.renders
    targets = model.feature_targets(photo)
    size = (photo.masks.shape[-2], photo.masks.shape[-1])
    mask = photo.masks[0].expand(3, -1, -1)
    overlay = (
        0.5 * photo.images[0] + 0.5 * renders.silhouette[0] * photo.images.new_tensor([1.0, 0.35, 0.1])[:, None, None]
    )
    pictures = [
        photo.images[0],
        mask,
        upsample(targets[:, :3], *size)[0] * photo.masks[0],
        overlay,
        renders.image(renders.shading.rgb)[0],
        renders.image(renders.shading.features)[0, :3],
    ]
    pictures = [F.interpolate(p[None], size=(cell, cell), mode="bilinear", antialias=True)[0] for p in pictures]
    pictures.append(shape_view(model, out.posed, "side", cell, out.camera.camera_from_world[0, :3, :3]))
    pictures += [shape_view(model, out.posed, view, cell) for view in VIEWS]
    strip = torch.cat([picture.cpu().clamp(0, 1) for picture in pictures], dim=2)
    return (strip.permute(1, 2, 0).numpy() * 255).round().astype(np.uint8)


def _with_captions(sheet: Image.Image, cell: int) -> Image.Image:
    captioned = Image.new("RGB", (sheet.width, sheet.height + 14), "white")
    captioned.paste(sheet, (0, 14))
    draw = ImageDraw.Draw(captioned)
    for index, name in enumerate(COLUMNS):
        draw.text((index * cell + 3, 1), name, fill="black")
    return captioned
