"""The published ``feat16.png`` codec: per-pixel feature vectors as RGB tiles laid side by side.

Channel ``c`` is colour ``c mod 3`` of tile ``c // 3``; unused colours of the last tile are padding.
"""

from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from fauna.data.stored import StoredFile, readable
from fauna.errors import FaunaError

Codec = Literal["unit", "signed"]
"""``"unit"``: value / 255, what 3D-Fauna trains on. ``"signed"``: value / 127 - 1, the inverse of the encoder, in [-1, 1]."""


def decode_feature_map(
    picture: UInt8[np.ndarray, "height wide 3"], *, channels: int, codec: Codec
) -> Float[Tensor, "chan height width"]:
    """Decode a tiled picture.

    Args:
        picture: (height, tiles * width, 3).
        channels: of the feature vectors; tiles = ceil(channels / 3), or one more when the writer padded a full tile.
        codec: see :data:`Codec`.

    Raises:
        FaunaError: if the picture's width is not that of the tiles (the maps are square).
    """
    height, wide = picture.shape[:2]
    tiles = -(-channels // 3)
    if wide not in (tiles * height, (tiles + 1) * height):
        raise FaunaError(
            f"feature map expects {tiles} square tiles for {channels} channels ({tiles * height}x{height}), got {wide}x{height}; remake it"
        )
    tiled = torch.from_numpy(picture).float().reshape(height, -1, height, 3)  # (row, tile, column, colour)
    stacked = tiled.permute(1, 3, 0, 2).reshape(-1, height, height)[:channels]
    return stacked / 255.0 if codec == "unit" else stacked / 127.0 - 1.0


def encode_feature_map(features: Float[Tensor, "chan height width"]) -> UInt8[np.ndarray, "height wide 3"]:
    """Encode vectors in [-1, 1] as ``round((f + 1) * 127)``, zero-padded to whole tiles."""
    return tile_channels(((features.clamp(-1, 1) + 1) * 127).round().to(torch.uint8))


def tile_channels(channels: UInt8[Tensor, "chan height width"]) -> UInt8[np.ndarray, "height wide 3"]:
    """8-bit channels as RGB tiles side by side, zero-padded to whole tiles: what a ``feat16.png`` holds."""
    chan, height, width = channels.shape
    tiles = -(-chan // 3)
    padded = torch.zeros(tiles * 3, height, width, dtype=torch.uint8)
    padded[:chan] = channels
    return padded.reshape(tiles, 3, height, width).permute(2, 0, 3, 1).reshape(height, tiles * width, 3).numpy()


def read_feature_map(path: StoredFile, *, channels: int, codec: Codec) -> Float[Tensor, "chan height width"]:
    """Read and decode a ``feat16.png``.

    Raises:
        FaunaError: if the file is missing, broken or of the wrong shape.
    """
    try:
        with Image.open(readable(path)) as picture:
            return decode_feature_map(np.array(picture.convert("RGB")), channels=channels, codec=codec)
    except (OSError, SyntaxError) as error:
        raise FaunaError(
            f"{path} expects a readable feature map, got {' '.join(str(error).split())}; remake it"
        ) from error
