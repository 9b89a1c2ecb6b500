"""Base colours of a model: factors and embedded pictures (glTF 2.0, section 3.9). Everything else of a material is ignored."""

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import Image

from fauna.models3d.glb import Glb, buffer_view


@dataclass(frozen=True)
class Material:
    """A base colour.

    Attributes:
        name: as in the file.
        colour: linear factor.
        texture: linear picture, row 0 at v = 0, ``None`` for a flat colour.
    """

    name: str
    colour: Float[np.ndarray, "3"]
    texture: Float[np.ndarray, "height width 3"] | None = None

    def at(self, uv: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 3"]:
        """Linear base colour at texture coordinates: bilinear, repeated beyond [0, 1]."""
        if self.texture is None:
            return np.broadcast_to(self.colour, (len(uv), 3)).copy()
        height, width = self.texture.shape[:2]
        x, y = uv[:, 0] * width - 0.5, uv[:, 1] * height - 0.5
        left, top = np.floor(x).astype(int), np.floor(y).astype(int)
        right, down = (x - left)[:, None], (y - top)[:, None]
        columns, rows = (left % width, (left + 1) % width), (top % height, (top + 1) % height)
        upper = (1 - right) * self.texture[rows[0], columns[0]] + right * self.texture[rows[0], columns[1]]
        lower = (1 - right) * self.texture[rows[1], columns[0]] + right * self.texture[rows[1], columns[1]]
        return self.colour * ((1 - down) * upper + down * lower)


def read_materials(glb: Glb) -> tuple[Material, ...]:
    """All materials, and the default one last, so that index -1 finds it.

    Raises:
        FaunaError: for a picture that cannot be read.
    """
    found = []
    for index in range(len(glb.document.get("materials", []))):
        entry = glb.entry("materials", index)
        base: dict[str, Any] = entry.get("pbrMetallicRoughness", {})
        texture = _texture(glb, base["baseColorTexture"]["index"]) if "baseColorTexture" in base else None
        colour = np.array(base.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0)), float)[:3]
        found.append(Material(str(entry.get("name", f"material{index}")), colour, texture))
    return (*found, Material("default", np.ones(3)))


def linear_from_srgb(value: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Decode the transfer function of sRGB (IEC 61966-2-1), values in [0, 1]."""
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def _texture(glb: Glb, index: int) -> Float[np.ndarray, "height width 3"]:
    number = glb.entry("textures", index).get("source")
    image = glb.entry("images", number)
    if "bufferView" not in image:
        raise glb.error("embedded pictures", f"images[{number}] outside the file")
    data = buffer_view(glb, image["bufferView"])
    try:
        with Image.open(io.BytesIO(data)) as picture:
            pixels = np.asarray(picture.convert("RGB"), float) / 255.0
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise glb.error(f"a PNG or JPEG in images[{number}]", f"a broken one ({type(error).__name__})") from error
    return linear_from_srgb(pixels)
