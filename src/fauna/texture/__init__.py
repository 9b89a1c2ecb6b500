"""Textures of reconstructions: baking, test-time fitting of colour and pose.

Names are imported when first asked for, so that :class:`Texture` costs no more than numpy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fauna.texture.baking import bake
    from fauna.texture.finetuning import finetune
    from fauna.texture.refinement import Refined, refine
    from fauna.texture.replay import baking_psnr, render_textured
    from fauna.texture.texture import BakedLight, Texture

_HOMES = {
    "BakedLight": "texture",
    "Refined": "refinement",
    "Texture": "texture",
    "bake": "baking",
    "baking_psnr": "replay",
    "finetune": "finetuning",
    "refine": "refinement",
    "render_textured": "replay",
}
__all__ = ["BakedLight", "Refined", "Texture", "bake", "baking_psnr", "finetune", "refine", "render_textured"]


def __getattr__(name: str) -> Any:
    """One of the package's public names."""
    if name in _HOMES:
        return getattr(import_module(f"fauna.texture.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
