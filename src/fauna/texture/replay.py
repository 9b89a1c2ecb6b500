"""A baked texture seen again with the fitted camera and light: what is lost on the way from network to picture."""

import math

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from fauna.model import FaunaModel
from fauna.texture.baking import albedo_at
from fauna.texture.texture import Texture
from fauna.texture.visible import Visible, one_row, see, texture_embedding
from fauna.types import Reconstruction


@torch.no_grad()
def render_textured(
    model: FaunaModel, out: Reconstruction, texture: Texture, *, row: int = 0, size: int
) -> tuple[Float[Tensor, "3 size size"], Visible]:
    """The animal over black, coloured by its texture as a viewer would: bilinear look-up, then shaded.

    Args:
        model: lends its rasteriser.
        out: the reconstruction that was baked.
        texture: of it.
        row: of the reconstruction.
        size: side of the picture, pixels.

    Returns:
        Colours, not clamped, and the pixels that show the mesh.
    """
    out = one_row(out, row)
    seen = see(model.renderer, out, (size, size))
    uv = torch.from_numpy(texture.uv[texture.faces]).to(seen.points)  # (face, 3, 2)
    face = seen.fragments.face_index.reshape(-1)[seen.pixels]
    place = torch.einsum("pk,pkc->pc", seen.fragments.barycentrics.reshape(-1, 3)[seen.pixels], uv[face])
    image = torch.from_numpy(texture.image).to(seen.points).permute(2, 0, 1)[None] / 255
    colour = F.grid_sample(image, 2 * place[None, None] - 1, padding_mode="border", align_corners=False)[0, :, 0].T
    return over_black(seen, colour / texture.light.exposure * seen.intensity[:, None]), seen


@torch.no_grad()
def render_network(
    model: FaunaModel, out: Reconstruction, *, row: int = 0, size: int
) -> tuple[Float[Tensor, "3 size size"], Visible]:
    """The same picture from the network itself, without antialiasing."""
    out = one_row(out, row)
    seen = see(model.renderer, out, (size, size))
    albedo = albedo_at(model.appearance, seen.points, texture_embedding(out))
    return over_black(seen, albedo * seen.intensity[:, None]), seen


def baking_psnr(model: FaunaModel, out: Reconstruction, texture: Texture, *, row: int = 0, size: int) -> float:
    """PSNR in dB between network and texture where the mesh is seen, colours clamped to [0, 1]."""
    network, seen = render_network(model, out, row=row, size=size)
    baked, _ = render_textured(model, out, texture, row=row, size=size)
    return psnr(at(network, seen), at(baked, seen))


def over_black(seen: Visible, colour: Float[Tensor, "pixel 3"]) -> Float[Tensor, "3 height width"]:
    """Colours of the visible pixels of a single row as a picture."""
    height, width = seen.fragments.face_index.shape[-2:]
    flat = colour.new_zeros(height * width, 3).index_copy(0, seen.pixels, colour)
    return flat.T.reshape(3, height, width)


def at(picture: Float[Tensor, "3 height width"], seen: Visible) -> Float[Tensor, "pixel 3"]:
    """Colours of a picture at the visible pixels."""
    return picture.flatten(1).T[seen.pixels]


def psnr(first: Float[Tensor, "pixel 3"], second: Float[Tensor, "pixel 3"]) -> float:
    """Peak signal-to-noise ratio in dB of colours in [0, 1] (clamped to it); infinite for equal ones."""
    error = float((first.clamp(0, 1) - second.clamp(0, 1)).square().mean())
    return math.inf if error == 0 else -10 * math.log10(error)
