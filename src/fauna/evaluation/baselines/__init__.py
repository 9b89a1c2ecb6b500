"""Baselines. One file each: ``baselines=[name]`` takes the object called ``BASELINE`` in ``baselines/name.py``."""

import importlib
import pkgutil
from collections.abc import Sequence

from fauna.errors import FaunaError
from fauna.evaluation.baselines.base import MeshBaseline, TransferBaseline


def available() -> list[str]:
    """Names of all baselines."""
    return sorted(module.name for module in pkgutil.iter_modules(__path__) if module.name != "base")


def check_baselines(names: Sequence[str]) -> None:
    """Refuse unknown names before any work starts.

    Raises:
        FaunaError: naming the first.
    """
    for name in names:
        if name not in available():
            raise FaunaError(
                f"baselines: expected names among {', '.join(available())}, got {name!r}; correct the list"
            )


def get_baseline(name: str) -> MeshBaseline | TransferBaseline:
    """The baseline of a checked name."""
    return importlib.import_module(f"{__name__}.{name}").BASELINE
