"""The stored form of a texture. Light imports only: exporters and viewers read it without the model."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8


@dataclass(frozen=True)
class BakedLight:
    """The light a texture was fitted under, and how its image relates to albedo.

    The model shades colour *codes* (not linear light): ``code = albedo * intensity`` with
    ``intensity = ambient + diffuse * max(0, direction . normal)``. Images hold ``albedo * exposure`` so that they look right
    in a viewer with lights of its own. Seen again: ``code = image / exposure * intensity``.

    Attributes:
        direction: unit vector towards the light, in the world frame of the posed mesh (y up, head at +z).
        ambient: in [0, 1].
        diffuse: in [0.5, 1].
        exposure: mean intensity over what the photograph shows of the animal, > 0.
    """

    direction: tuple[float, float, float]
    ambient: float
    diffuse: float
    exposure: float

    def extras(self) -> dict[str, float | list[float]]:
        """As plain values, e.g. for the ``extras`` of a glTF material."""
        return {
            "direction": list(self.direction),
            "ambient": self.ambient,
            "diffuse": self.diffuse,
            "exposure": self.exposure,
        }


@dataclass(frozen=True, eq=False)
class Texture:
    """A UV atlas of a mesh and its image.

    Attributes:
        vertex: index of the mesh vertex each UV vertex lies at; a vertex on a seam has several.
        faces: UV vertices of each face, in the order and winding of the mesh's faces.
        uv: in [0, 1]; (0, 0) is the TOP LEFT corner of the image, v points down, as in glTF.
        image: 8-bit sRGB codes, row 0 at the top; no texel is empty.
        light: what the image has to be shaded with to give the photograph's colours again.
    """

    vertex: Int[np.ndarray, " uv_vert"]
    faces: Int[np.ndarray, "face 3"]
    uv: Float[np.ndarray, "uv_vert 2"]
    image: UInt8[np.ndarray, "size size 3"]
    light: BakedLight
