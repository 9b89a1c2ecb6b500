"""Nested frozen dataclasses from the nested keys of a YAML file, which is their only home."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, get_type_hints

from fauna.errors import FaunaError

Group = TypeVar("Group")


def build_group(kind: type[Group], content: Mapping[str, Any], *, file: str, path: str = "") -> Group:
    """A dataclass whose fields are exactly the keys; lists become tuples.

    Args:
        kind: the dataclass.
        content: of the file, or of a group in it.
        file: named in messages.
        path: of the group, with a dot at its end.

    Raises:
        FaunaError: for a missing or an unknown key.
    """
    hints = get_type_hints(kind)
    names = {field.name for field in fields(kind)}  # type: ignore[arg-type]
    if not isinstance(content, Mapping) or set(content) != names:
        odd = sorted(set(content) ^ names) if isinstance(content, Mapping) else [content]
        raise FaunaError(
            f"{file}: expected the keys {sorted(names)} in {path or 'the file'}, got {odd} otherwise; mend it"
        )
    values = {
        name: build_group(hints[name], value, file=file, path=f"{path}{name}.")
        if is_dataclass(hints[name])
        else tuple(value)
        if isinstance(value, list)
        else value
        for name, value in content.items()
    }
    return kind(**values)
