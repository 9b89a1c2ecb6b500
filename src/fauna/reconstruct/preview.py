"""``preview.png``: what went in and what came out, side by side."""

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image, ImageDraw
from scipy.ndimage import binary_dilation, binary_erosion
from torch import Tensor
from torch.nn import functional as F

from fauna.geometry.camera import to_clip
from fauna.geometry.mesh import vertex_normals
from fauna.io.contact_sheet import shape_view
from fauna.reconstruct.result import Fit, Result
from fauna.types import Reconstruction

COLUMNS = ("photograph and mask", "overlay", "mesh", "texture", "side", "skeleton")
HEADER, FOOTER = 16, 16
"""Heights of the captions, pixels."""
OUTLINE, TINT = (1.0, 0.35, 0.1), (1.0, 0.6, 0.28)
SPINE, LEGS = (214, 69, 65), ((34, 139, 80), (52, 110, 200), (120, 170, 235), (130, 200, 120))
SUPERSAMPLE = 2


@torch.no_grad()
def preview(result: Result, *, cell: int) -> Image.Image:
    """:data:`COLUMNS` and, below them, status, confidence and flags.

    Args:
        result: with an animal.
        cell: side of a picture, pixels.
    """
    assert result.fit is not None, "only for results with an animal"
    fit = result.fit
    size = cell * SUPERSAMPLE
    photo = _photo(fit, size)
    colour, coverage = _textured(result, fit, size)
    shade = shaded(fit, size)
    tint = shade * torch.tensor(TINT)[:, None, None]
    pictures = [
        _outlined(photo, fit, size),
        photo * (1 - 0.6 * coverage) + 0.6 * coverage * tint,
        (shade * coverage + (1 - coverage)).expand(3, -1, -1),
        colour + (1 - coverage),
        F.interpolate(shape_view(fit.model, fit.out.posed, "side", cell)[None], (size, size))[0].cpu(),
        _skeleton(photo, fit.out, size),
    ]
    strip = torch.cat([F.avg_pool2d(each[None], SUPERSAMPLE)[0].clamp(0, 1) for each in pictures], dim=2)
    return _captioned(Image.fromarray((strip.permute(1, 2, 0).numpy() * 255).round().astype(np.uint8)), result, cell)


def _textured(result: Result, fit: Fit, size: int) -> tuple[Float[Tensor, "3 size size"], Float[Tensor, "1 size size"]]:
    """The animal in the photograph's camera, in the colours of its texture (or of the network) over black, and its coverage."""
    from fauna.texture.replay import render_network, render_textured

    baked = result.texture
    if baked is None:
        colour, seen = render_network(fit.model, fit.out, size=size)
    else:
        colour, seen = render_textured(fit.model, fit.out, baked, size=size)
    return colour.cpu(), seen.fragments.covered[:1].float().cpu()


@torch.no_grad()
def shaded(fit: Fit, size: int) -> Float[Tensor, "1 size size"]:
    """Headlight shading of the mesh in the photograph's camera, in [0, 1].

    Args:
        fit: the animal.
        size: side, pixels.
    """
    renderer, posed, camera = fit.model.renderer, fit.out.posed, fit.out.camera
    fragments = renderer.rasterize(to_clip(posed.verts, camera.clip_from_world), posed.faces, size, size)
    normals = vertex_normals(posed.verts, posed.faces) @ camera.camera_from_world[:, :3, :3].transpose(1, 2)
    facing = F.normalize(renderer.interpolate(fragments, posed.faces, normals)[0], dim=0)
    return (0.25 + 0.75 * (0.35 * facing[1:2] + 0.93 * facing[2:3]).abs()).clamp(0, 1).cpu()


def _photo(fit: Fit, size: int) -> Float[Tensor, "3 size size"]:
    picture = Image.fromarray(fit.crop).resize((size, size), Image.Resampling.BILINEAR)
    return torch.from_numpy(np.array(picture)).permute(2, 0, 1).float() / 255.0


def _outlined(photo: Float[Tensor, "3 size size"], fit: Fit, size: int) -> Float[Tensor, "3 size size"]:
    """The photograph, darker around the mask, with the mask's outline."""
    mask = np.array(Image.fromarray(fit.mask).resize((size, size), Image.Resampling.NEAREST))
    line = torch.from_numpy(
        np.asarray(binary_dilation(mask, iterations=2)) & ~np.asarray(binary_erosion(mask, iterations=2), bool)
    )
    darker = photo * torch.where(torch.from_numpy(mask), 1.0, 0.55)
    return torch.where(line, torch.tensor(OUTLINE)[:, None, None], darker)


def _skeleton(photo: Float[Tensor, "3 size size"], out: Reconstruction, size: int) -> Float[Tensor, "3 size size"]:
    """The posed bones over the pale photograph."""
    pale = ((0.45 * photo + 0.55).clamp(0, 1).permute(1, 2, 0).numpy() * 255).round().astype(np.uint8)
    picture = Image.fromarray(pale)
    starts, ends = out.posed.bone_starts, out.posed.bone_ends
    if starts is not None and ends is not None:
        pen = ImageDraw.Draw(picture)
        places = [_pixels(points[:1], out, size) for points in (starts, ends)]
        for bone, (start, end) in enumerate(zip(*places, strict=True)):
            colour = SPINE if bone < 8 else LEGS[(bone - 8) // 3]
            pen.line([*start, *end], fill=colour, width=max(size // 100, 2))
            radius = size / 90
            pen.ellipse([start[0] - radius, start[1] - radius, start[0] + radius, start[1] + radius], fill=colour)
    return torch.from_numpy(np.array(picture)).permute(2, 0, 1).float() / 255.0


def _pixels(points: Float[Tensor, "1 bone 3"], out: Reconstruction, size: int) -> list[list[float]]:
    clip = to_clip(points, out.camera.clip_from_world[:1])[0]
    return ((clip[:, :2] / clip[:, 3:] + 1.0) * (0.5 * size)).cpu().tolist()


def _captioned(strip: Image.Image, result: Result, cell: int) -> Image.Image:
    sheet = Image.new("RGB", (strip.width, strip.height + HEADER + FOOTER), "white")
    sheet.paste(strip, (0, HEADER))
    pen = ImageDraw.Draw(sheet)
    for index, name in enumerate(COLUMNS):
        pen.text((index * cell + 3, 2), name, fill="black")
    words = [each.replace("_", " ") for each in (result.status, f"confidence {result.confidence:.2f}", *result.flags)]
    pen.text((3, HEADER + strip.height + 2), "   ".join([result.name, *words]), fill="black")
    return sheet
