"""Pictures by which people judge feature maps: the share of variance, and the maps across species."""

import io
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw
from torch import Tensor

from fauna.data.photo_files import decode_image
from fauna.encoder.base import Encoder
from fauna.encoder.feature_space import FeatureSpace
from fauna.prepare.basis import Chosen, encode_crop
from fauna.prepare.settings import Settings
from fauna.prepare.workspace import Workspace

SPECIES, EACH = 16, 3
"""Species and animals of each that are shown."""
TRIPLES = ((0, 1, 2), (3, 4, 5), (6, 7, 8))
"""Channels shown as red, green, blue."""


def draw_maps(
    chosen: Sequence[Chosen], encoder: Encoder, space: FeatureSpace, settings: Settings, workspace: Workspace
) -> bytes:
    """A line for each species: animals with their maps; the same part of the body should have the same colour everywhere.

    Args:
        chosen: crops the basis was fitted to.
        encoder: of the maps.
        space: fitted.
        settings: group ``sheets`` gives the size.
        workspace: where crops are.
    """
    cell = settings.sheets.cell
    species = sorted({name for _, name, _ in chosen})[:SPECIES]
    width = EACH * (1 + len(TRIPLES)) * cell
    sheet = Image.new("RGB", (width, len(species) * (cell + 14)), "white")
    pen = ImageDraw.Draw(sheet)
    for line, name in enumerate(species):
        top = line * (cell + 14)
        pen.text((3, top + 1), f"{name}: photo, channels 1-3, 4-6, 7-9", fill="black")
        rows = [row for row, kind, _ in chosen if kind == name][:EACH]
        for place, row in enumerate(rows):
            for column, picture in enumerate(_pictures(row, encoder, space, workspace)):
                left = (place * (1 + len(TRIPLES)) + column) * cell
                sheet.paste(picture.resize((cell - 2, cell - 2), Image.Resampling.BILINEAR), (left, top + 13))
    buffer = io.BytesIO()
    sheet.save(buffer, "PNG")
    return buffer.getvalue()


def draw_variance(variance: Sequence[float]) -> bytes:
    """Bars of the explained variance with their sum."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5, 3), layout="constrained")
    axes = figure.subplots()
    axes.bar(range(1, len(variance) + 1), [100 * value for value in variance], label="component")
    axes.plot(range(1, len(variance) + 1), 100 * np.cumsum(variance), color="tab:orange", label="sum")
    axes.set_xlabel("principal component of foreground features")
    axes.set_ylabel("explained variance, %")
    axes.legend()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120, metadata={"Software": None})
    return buffer.getvalue()


def _pictures(row: str, encoder: Encoder, space: FeatureSpace, workspace: Workspace) -> list[Image.Image]:
    crop = workspace.crop(row, "rgb.jpg")
    maps = space.targets(encode_crop(encoder, crop))[0]
    mask = decode_image(workspace.crop(row, "mask.png"), "L")
    coverage = np.asarray(Image.fromarray(mask).resize((256, 256))) / 255.0
    return [
        Image.fromarray(decode_image(crop, "RGB")),
        *(_coloured(maps[list(triple)], coverage) for triple in TRIPLES if max(triple) < len(maps)),
    ]


def _coloured(maps: Float[Tensor, "3 grid grid"], coverage: Float[np.ndarray, "side side"]) -> Image.Image:
    """Three channels on the animal, white elsewhere."""
    size = coverage.shape
    spread = ((maps - 0.5) * 2.0 + 0.5).clamp(0.0, 1.0)
    large = torch.nn.functional.interpolate(spread[None], size=size, mode="bilinear", align_corners=False)[0]
    blended = large.permute(1, 2, 0).numpy() * coverage[..., None] + 1.0 - coverage[..., None]
    pixels: UInt8[np.ndarray, "side side 3"] = (blended * 255).round().astype(np.uint8)
    return Image.fromarray(pixels)
