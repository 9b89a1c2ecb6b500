"""The albedo of a reconstruction as a picture over its surface."""

from typing import Literal, get_args

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from fauna.appearance.base import Appearance
from fauna.errors import FaunaError
from fauna.model import FaunaModel
from fauna.texture.atlas import Texels, fill, texels_of, unwrap
from fauna.texture.projection import project_photo
from fauna.texture.texture import BakedLight, Texture
from fauna.texture.visible import Visible, one_row, see, texture_embedding
from fauna.types import Batch, Reconstruction

Source = Literal["network", "photo"]

_BLOCK = 1 << 16
"""Texels that go through the network at once."""


@torch.no_grad()
def bake(
    model: FaunaModel,
    out: Reconstruction,
    *,
    row: int = 0,
    size: int,
    source: Source = "network",
    batch: Batch | None = None,
) -> Texture:
    """Store the colour of the rest mesh as an image over a UV atlas.

    ``network`` is the albedo field of the paper (Sec. 3.1, "Appearance"). ``photo`` lays the photograph's pixels on what they
    show, see :func:`fauna.texture.projection.project_photo`; the network only fills what is never seen.

    Args:
        model: whose appearance it is, e.g. fitted by :func:`fauna.texture.finetuning.finetune`.
        out: its reconstruction.
        row: of the reconstruction.
        size: side of the image, texels.
        source: see above.
        batch: the photographs of ``out``, needed by ``photo``; a finer crop of the same window gives a finer texture.

    Raises:
        FaunaError: when there is no such row, the size makes no sense, or the photograph is missing.
    """
    if source not in get_args(Source) or (source == "photo" and batch is None):
        raise FaunaError(f"texture: expected source network, or photo with a batch, got {source!r} without; pass batch")
    out = one_row(out, row)
    atlas = unwrap(out.instance.verts[0], out.base.faces, out.base.topology, size=size)
    texels = texels_of(model.renderer, atlas, size)
    seen = see(model.renderer, out, (out.renders.silhouette.shape[-2], out.renders.silhouette.shape[-1]))
    light = _light(out, seen)
    albedo = albedo_at(model.appearance, texels.interpolate(out.base.verts), texture_embedding(out))
    if batch is not None and source == "photo":
        albedo = project_photo(model.renderer, batch, out, texels, albedo)
    image = _image(albedo * light.exposure, texels)
    vertex, faces, uv = (each.cpu().numpy() for each in (atlas.vertex, atlas.faces, atlas.uv))
    return Texture(vertex, faces, uv, image, light)


@torch.no_grad()
def albedo_at(
    appearance: Appearance, points: Float[Tensor, "point 3"], texture: Float[Tensor, "1 texture_chan"]
) -> Float[Tensor, "point 3"]:
    """Albedo at many canonical points of one row, in blocks."""
    blocks = points.split(_BLOCK)
    row = torch.zeros(_BLOCK, dtype=torch.long, device=points.device)
    return torch.cat([appearance.albedo(block, texture, row[: len(block)]) for block in blocks])


def _light(out: Reconstruction, seen: Visible) -> BakedLight:
    direction = out.camera.camera_from_world[0, :3, :3].T @ out.light.direction[0]
    x, y, z = direction.tolist()
    exposure = float(seen.intensity.mean()) if len(seen.pixels) else 1.0
    return BakedLight((x, y, z), float(out.light.ambient[0]), float(out.light.diffuse[0]), max(exposure, 1e-3))


def _image(colour: Float[Tensor, "texel 3"], texels: Texels) -> UInt8[np.ndarray, "size size 3"]:
    size = texels.size
    image = np.zeros((size * size, 3), np.uint8)
    known = np.zeros(size * size, bool)
    index = texels.index.cpu().numpy()
    image[index], known[index] = (colour.clamp(0, 1) * 255).round().byte().cpu().numpy(), True
    return fill(image.reshape(size, size, 3), known.reshape(size, size))
