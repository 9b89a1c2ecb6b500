"""Rigged animals as files: names, weights and clips of a skeleton that all species share (``docs/skeleton.md``)."""

from fauna.export.animal import Clip, RiggedAnimal, UvTexture
from fauna.export.colours import vertex_colours
from fauna.export.glb import glb_bytes, write_glb
from fauna.export.meshes import write_obj, write_ply
from fauna.export.rig import rig_reconstruction

__all__ = [
    "Clip",
    "RiggedAnimal",
    "UvTexture",
    "glb_bytes",
    "rig_reconstruction",
    "vertex_colours",
    "write_glb",
    "write_obj",
    "write_ply",
]
