"""The model inside the package: where its files are, and whether they are what was published."""

import atexit
import hashlib
import json
import sys
from contextlib import ExitStack
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from fauna.errors import FaunaError

if sys.version_info >= (3, 11):
    from importlib.resources.abc import Traversable
else:
    from importlib.abc import Traversable

PRETRAINED = "pretrained"
"""What ``checkpoint=`` and ``init_from=`` call the shipped model."""

MODEL = "quadrupeds"
WEIGHTS, CONFIG, CARD, METRICS, INDEX = "weights.safetensors", "config.yaml", "card.md", "metrics.json", "index.json"
MAX_BYTES = 12_000_000
"""Of a weight file: what a package may ask everybody to download."""

_UNPACKED = ExitStack()  # files of a zipped package, until the program ends
atexit.register(_UNPACKED.close)


def shipped_weights() -> Path:
    """The weight file inside the package, its SHA-256 checked.

    Raises:
        FaunaError: when this version ships no model, or the file is not the one that was published.
    """
    return _verified(_folder())


def shipped_text(name: str) -> str:
    """One of the texts beside the weights: :data:`CONFIG`, :data:`CARD` or :data:`METRICS`.

    Raises:
        FaunaError: when this version ships no model.
    """
    folder = _folder()
    _index(folder)
    return folder.joinpath(name).read_text(encoding="utf-8")


def sha256(content: bytes) -> str:
    """Hexadecimal digest."""
    return hashlib.sha256(content).hexdigest()


def _folder() -> Traversable:
    return files("fauna.pretrained").joinpath(MODEL)


@cache
def _verified(folder: Traversable) -> Path:
    recorded = _index(folder)["files"]
    for name, wanted in sorted(recorded.items()):
        try:
            found = sha256(folder.joinpath(name).read_bytes())
        except OSError as error:
            raise _damaged(name, "a readable file", error.strerror or type(error).__name__) from error
        if found != wanted:
            raise _damaged(name, f"SHA-256 {wanted[:16]}", found[:16])
    return _UNPACKED.enter_context(as_file(folder.joinpath(WEIGHTS)))


def _index(folder: Traversable) -> dict[str, Any]:
    """What was published: ``files``, names with their digests."""
    index = folder.joinpath(INDEX)
    if not index.is_file():
        raise FaunaError(
            "pretrained: expected a model inside the package, got none: no model ships with this version; train one with "
            "fauna-train +experiment=quickstart and name its run folder"
        )
    try:
        content = json.loads(index.read_text(encoding="utf-8"))
        if WEIGHTS in content["files"]:
            return content
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise _damaged(INDEX, "digests of the model's files", type(error).__name__) from error
    raise _damaged(INDEX, f"a digest of {WEIGHTS}", "none")


def _damaged(name: str, expected: str, got: str) -> FaunaError:
    return FaunaError(
        f"pretrained: expected {expected} in {name} of the installed package, got {got}; the installation is damaged, "
        "install fauna again"
    )
