"""Articulated 3D animals learned from photographs."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fauna.model import FaunaModel
    from fauna.reconstruct.load import load

__version__ = "0.1.0"
__all__ = ["FaunaModel", "__version__", "load"]


def __getattr__(name: str) -> Any:
    """``fauna.FaunaModel`` and ``fauna.load``, imported when first asked for, so that the commands start at once."""
    if name == "FaunaModel":
        from fauna.model import FaunaModel

        return FaunaModel
    if name == "load":
        from fauna.reconstruct.load import load

        return load
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
