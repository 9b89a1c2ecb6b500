"""Nothing of the machine that trained a model ships with it."""

import re
from collections.abc import Mapping
from typing import Any

from fauna.errors import FaunaError

MACHINE_KEYS = ("root", "split_file", "resume", "init_from", "init_components", "save_dir", "folder")
"""Keys whose value names files of one machine, or means nothing without them; they ship as null."""

ABSOLUTE = re.compile(
    r"(?:^|[\s'\"(=\[,`:])((?:~\w*|file://)?/[\w.~-]+(?:/[\w.~-]*)*|[A-Za-z]:[\\/][\w\\/.~-]*)", re.MULTILINE
)
"""An absolute path of any system within a text; group 1 is the path. Addresses (``https://...``) are none."""


def without_machine(config: Mapping[str, Any]) -> dict[str, Any]:
    """A run's configuration without the places of its machine; ``out`` becomes what a fresh run of that name would use.

    Args:
        config: plain containers.

    Raises:
        FaunaError: naming a key that still holds an absolute path.
    """
    cleaned = {key: _clean(str(key), value) for key, value in config.items()}
    if "out" in cleaned:
        cleaned["out"] = f"runs/{cleaned.get('name', 'train')}"
    for key, value in _leaves(cleaned, ""):
        refuse_paths(key, value)
    return cleaned


def refuse_paths(what: str, text: str) -> None:
    """Raises FaunaError when a text that is about to ship holds an absolute path."""
    found = ABSOLUTE.search(text)
    if found:
        raise FaunaError(f"{what}: expected no absolute path in what ships, got {found[1]}; take it out")


def _clean(key: str, value: Any) -> Any:
    if key in MACHINE_KEYS:
        return None
    if isinstance(value, Mapping):
        return {name: _clean(str(name), each) for name, each in value.items()}
    if isinstance(value, list):
        return [_clean("", each) for each in value]
    return value


def _leaves(node: Any, path: str) -> list[tuple[str, str]]:
    """Every text below a node with its dotted key."""
    if isinstance(node, Mapping):
        return [leaf for key, each in node.items() for leaf in _leaves(each, f"{path}.{key}" if path else str(key))]
    if isinstance(node, list):
        return [leaf for place, each in enumerate(node) for leaf in _leaves(each, f"{path}[{place}]")]
    return [(path, node)] if isinstance(node, str) else []
