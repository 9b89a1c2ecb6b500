"""The surface as files want it: split along the texture's seams, with normals and colours."""

import io
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from PIL import Image

from fauna.export.animal import RiggedAnimal, UvTexture
from fauna.geometry.mesh import build_topology, vertex_normals


@dataclass(frozen=True, eq=False)
class Split:
    """Vertices of a file.

    Attributes:
        vertex: (out,) the mesh's vertex of each vertex of the file.
        faces: (face, 3) into them.
        uv: (out, 2) origin at the picture's top left, or ``None`` without texture.
    """

    vertex: Int[np.ndarray, " out"]
    faces: Int[np.ndarray, "face 3"]
    uv: Float[np.ndarray, "out 2"] | None


def split_at_seams(animal: RiggedAnimal) -> Split:
    """A vertex for each place in the texture; the mesh's own without one."""
    if animal.texture is None:
        return Split(np.arange(len(animal.vertices)), animal.faces, None)
    texture = animal.texture
    uv = np.asarray(texture.uv, np.float64).clip(0.0, 1.0)
    return Split(np.asarray(texture.vertex, np.int64), np.asarray(texture.faces, np.int64), uv)


def normals(vertices: Float[np.ndarray, "vert 3"], faces: Int[np.ndarray, "face 3"]) -> Float[np.ndarray, "vert 3"]:
    """Unit normals of the welded mesh, so that seams do not show."""
    single = torch.from_numpy(vertices.astype(np.float32))[None]  # the precision the kernel is compiled for anyway
    return vertex_normals(single, torch.from_numpy(faces))[0].numpy()


def is_closed(faces: Int[np.ndarray, "face 3"]) -> bool:
    """Whether every edge has a face on both sides."""
    return bool((build_topology(torch.from_numpy(faces)).edge_faces >= 0).all())


def linear_from_srgb(colours: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """IEC 61966-2-1, in [0, 1]: vertex colours of glTF are linear."""
    colours = colours.clip(0.0, 1.0)
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def picture(texture: UvTexture) -> Image.Image:
    """The texture's picture, 8-bit RGB."""
    return Image.fromarray(np.asarray(texture.image, np.uint8))


def png(texture: UvTexture) -> bytes:
    """The texture's picture as a PNG file."""
    content = io.BytesIO()
    picture(texture).save(content, "PNG")
    return content.getvalue()
