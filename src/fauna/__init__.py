"""Articulated 3D animals learned from photographs."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fauna.model import FaunaModel

__version__ = "0.1.0"
__all__ = ["FaunaModel", "__version__"]


def __getattr__(name: str) -> Any:
    """``fauna.FaunaModel``, imported when first asked for, so that the commands start at once."""
    if name == "FaunaModel":
        from fauna.model import FaunaModel

        return FaunaModel
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
