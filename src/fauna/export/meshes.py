"""The animal without its skeleton, in the photo's pose, through trimesh."""

from pathlib import Path

import numpy as np
import trimesh
from trimesh.exchange.obj import export_obj
from trimesh.exchange.ply import export_ply
from trimesh.visual.material import SimpleMaterial
from trimesh.visual.texture import TextureVisuals

from fauna.export.animal import RiggedAnimal
from fauna.export.surface import picture, split_at_seams


def write_obj(animal: RiggedAnimal, path: Path) -> None:
    """Write a Wavefront OBJ, with ``<stem>.mtl`` and ``<stem>.png`` beside it when the animal has a texture.

    Raises:
        OSError: when a file cannot be written.
    """
    mesh = posed_mesh(animal)
    if isinstance(mesh.visual, TextureVisuals):
        mesh.visual.material.name = path.stem
    text, others = export_obj(mesh, return_texture=True, mtl_name=f"{path.stem}.mtl", header=animal.name)
    for name, content in others.items():
        (path.parent / name).write_bytes(content)
    path.write_text(text, encoding="utf-8")


def write_ply(animal: RiggedAnimal, path: Path) -> None:
    """Write a binary PLY, with vertex colours where the animal has them.

    Raises:
        OSError: when the file cannot be written.
    """
    mesh = posed_mesh(animal)
    path.write_bytes(export_ply(mesh, vertex_normal=True))


def posed_mesh(animal: RiggedAnimal) -> trimesh.Trimesh:
    """The mesh in the photo's pose, metres, with its texture or its colours."""
    split = split_at_seams(animal)
    vertices = animal.pose(animal.photo)[split.vertex]
    visual, colours = None, None
    if animal.texture is not None and split.uv is not None:
        uv = np.stack((split.uv[:, 0], 1.0 - split.uv[:, 1]), axis=1)  # OBJ counts v from below
        visual = TextureVisuals(uv=uv, material=SimpleMaterial(image=picture(animal.texture)))
    elif animal.colours is not None:
        colours = (animal.colours.clip(0.0, 1.0) * 255.0).round().astype(np.uint8)
    return trimesh.Trimesh(vertices, split.faces, visual=visual, vertex_colors=colours, process=False)
