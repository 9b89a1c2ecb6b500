"""Checks a composed configuration before any work starts; every message names key, expected, received and remedy."""

import collections.abc
import difflib
import inspect
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, Union, get_args, get_origin

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from fauna.errors import FaunaError
from fauna.limits import check_ranges
from fauna.losses.objective import IMAGE_TERMS, TERMS
from fauna.precision import Precision

MODEL_GROUPS = (
    *("feature_space", "mask_embedding", "bank", "embedder", "viewpoint", "shape", "deformation", "rig"),
    *("articulation", "appearance", "renderer"),
)
"""Groups of the model beside its encoder, in the order of the data flow."""

ROOT_KEYS = (
    *("encoder", *MODEL_GROUPS, "discriminator", "losses", "optimizer", "schedule", "data", "trainer", "callbacks"),
    *("logger", "name", "seed", "out", "resume", "init_from", "init_components", "camera"),
    *("feature_lookup", "field_precision", "batch_code", "shade_fraction"),
)
"""What ``conf/train.yaml`` holds: its groups and its own keys."""

GIVEN_BY_CODE = ("encoder", "callbacks", "logger", "folder", "config", "schedule", "save_dir")
"""Constructor arguments that code passes in, or that are components; absent from YAML they are no error."""

FACTS = {
    "encoder": ("name", "global_dim", "token_dim", "grid_size", "offline_fallback", "replaces"),
    "bank": ("value_dim",),
}
"""Keys of a group that other groups read, or that act before composition; no constructor needs to know them."""

EXAMPLES: dict[Any, str] = {int: "60", float: "0.001", bool: "true", str: "a word"}


def validate(cfg: DictConfig) -> None:
    """Bind every node with a ``_target_`` to the signature of what it names; whole numbers become floats where those belong.

    Raises:
        FaunaError: on the first unknown key, missing key or value of a wrong type.
    """
    _check_root(cfg)
    check_targets(cfg, "")
    check_ranges(cfg)


def check_targets(cfg: DictConfig, path: str) -> None:
    """Bind every node with a ``_target_`` as :func:`validate` does.

    Args:
        cfg: a composed configuration or one node of it.
        path: dotted key of ``cfg``, empty for the whole.

    Raises:
        FaunaError: on the first unknown key, missing key or value of a wrong type.
    """
    for key, node in _targets(cfg, path):
        _check_node(key, node)


def _check_root(cfg: DictConfig) -> None:
    rules = {
        "seed": int,
        "resume": str | None,
        "out": str,
        "name": str,
        "init_from": str | None,
        "init_components": Sequence[str] | None,
        "feature_lookup": Literal["vertices", "pixels"],
        "field_precision": Precision,
        "batch_code": Literal["mean", "one"],
        "shade_fraction": float,
    }
    for key in cfg:
        if key not in ROOT_KEYS:
            close = difflib.get_close_matches(str(key), ROOT_KEYS, n=1)
            hint = f"did you mean {close[0]}?" if close else f"known keys: {', '.join(ROOT_KEYS)}"
            raise FaunaError(f"{key}: expected a known key, got an unknown one; {hint}")
    for key, expected in rules.items():
        check_value(key, _value(cfg, key, key), expected)
    if cfg.seed < 0:
        raise FaunaError(f"seed: expected a whole number >= 0, got {cfg.seed}; e.g. seed=0")
    if cfg.init_components is not None and cfg.init_from is None:
        raise FaunaError("init_components: expected init_from beside it, got none; add init_from=WEIGHTS")
    terms = {"weights": TERMS, "target_weights": IMAGE_TERMS}
    for group, known in terms.items():
        for name in cfg.schedule.get(group, {}):
            if name not in known:
                raise FaunaError(
                    f"schedule.{group}.{name}: expected one of {', '.join(known)}, got {name!r}; mend the name"
                )


def _targets(node: Any, path: str) -> Iterator[tuple[str, DictConfig]]:
    """Every mapping with a ``_target_`` below (and including) ``node``, with its dotted path."""
    if isinstance(node, DictConfig):
        if "_target_" in node:
            yield path, node
        for key in map(str, node):
            inner = f"{path}.{key}" if path else key
            if not OmegaConf.is_missing(node, key) and not OmegaConf.is_interpolation(node, key):
                yield from _targets(node._get_node(key), inner)


def _check_node(path: str, node: DictConfig) -> None:
    try:
        function = _locate(node._target_)
    except Exception as error:
        raise FaunaError(
            f"{path}._target_: expected an importable class or function, got {node._target_} ({error}); correct the name"
        ) from error
    parameters = {
        name: parameter
        for name, parameter in inspect.signature(function).parameters.items()
        if parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY)
    }
    open_ended = any(p.kind is p.VAR_KEYWORD for p in inspect.signature(function).parameters.values())
    hints = _hints(function)
    for key in node:
        name = str(key)
        if name.startswith("_") or (name in FACTS.get(path, ()) and name not in parameters):
            continue
        if name not in parameters:
            if open_ended:
                continue
            close = difflib.get_close_matches(name, parameters, n=1)
            hint = f"did you mean {path}.{close[0]}?" if close else f"known keys: {', '.join(sorted(parameters))}"
            raise FaunaError(f"{path}.{name}: expected a key of {node._target_}, got an unknown one; {hint}")
        expected, value = hints.get(name, Any), _value(node, name, f"{path}.{name}")
        check_value(f"{path}.{name}", value, expected)
        number = as_numbers(expected, value)
        if repr(number) != repr(value) and not OmegaConf.is_interpolation(node, name):
            node[name] = number
    for name, parameter in parameters.items():
        if parameter.default is parameter.empty and name not in node and name not in GIVEN_BY_CODE:
            raise FaunaError(
                f"{path}.{name}: expected a value for {node._target_}, got none; add {path}.{name}=... or choose a file of "
                "the group that has it"
            )


def _locate(target: str) -> Any:
    from hydra._internal.utils import _locate as locate

    return locate(target)


def _hints(function: Any) -> dict[str, Any]:
    try:
        return typing.get_type_hints(function.__init__ if inspect.isclass(function) else function)
    except Exception:
        return {}


def _value(node: DictConfig, key: str, path: str) -> Any:
    try:
        value = node[key]
    except OmegaConfBaseException as error:
        reason = str(error).splitlines()[0]
        raise FaunaError(f"{path}: expected a value, got none ({reason}); give it on the command line") from error
    return OmegaConf.to_container(value, resolve=True) if OmegaConf.is_config(value) else value


def check_value(path: str, value: Any, expected: Any) -> None:
    """Refuse a value that does not fit a type annotation.

    Args:
        path: dotted key, for the message.
        value: of the configuration, plain containers.
        expected: annotation.

    Raises:
        FaunaError: naming the key.
    """
    if not accepts(expected, value):
        example = EXAMPLES.get(expected, "")
        hint = f"e.g. {path}={example}" if example else "see the comments of its YAML file"
        if get_origin(expected) is Literal:
            hint = "choose one of them"
        raise FaunaError(f"{path}: expected {_spell(expected)}, got {value!r} ({type(value).__name__}); {hint}")


def accepts(expected: Any, value: Any) -> bool:
    """Whether a YAML value fits a type annotation; unknown annotations accept everything.

    >>> accepts(int, 3), accepts(int, "abc"), accepts(int, True), accepts(float, 3), accepts(int | None, None)
    (True, False, False, True, True)
    """
    if isinstance(value, Mapping) and "_target_" in value:
        return True
    origin = get_origin(expected)
    if origin in (Union, types.UnionType):
        return any(accepts(option, value) for option in get_args(expected))
    if origin is Literal:
        return value in get_args(expected)
    if expected is int:
        return isinstance(value, int) and not isinstance(value, bool)
    if expected is float:
        return isinstance(value, (int, float)) and not isinstance(value, bool)
    if expected in (bool, str):
        return isinstance(value, expected)
    if expected is type(None):
        return value is None
    if origin in (list, tuple, collections.abc.Sequence):
        return isinstance(value, (list, tuple)) and _items_fit(get_args(expected), value)
    if origin in (dict, collections.abc.Mapping):
        return isinstance(value, Mapping)
    return True


def as_numbers(expected: Any, value: Any) -> Any:
    """The value, with whole numbers turned into floats where only floats are expected.

    >>> as_numbers(float, 3), as_numbers(float | None, 3), as_numbers(int | float, 3), as_numbers(list[float], [1, 2.5])
    (3.0, 3.0, 3, [1.0, 2.5])
    """
    options = get_args(expected) if get_origin(expected) in (Union, types.UnionType) else (expected,)
    if isinstance(value, int) and not isinstance(value, bool):
        return float(value) if float in options and int not in options else value
    sequences = [option for option in options if get_origin(option) in (list, tuple, collections.abc.Sequence)]
    if isinstance(value, list) and sequences:
        return [as_numbers(get_args(sequences[0])[0], item) for item in value]
    return value


def _items_fit(arguments: tuple[Any, ...], value: Any) -> bool:
    if not arguments:
        return True
    if len(arguments) == 1 or arguments[-1] is Ellipsis:
        return all(accepts(arguments[0], item) for item in value)
    return len(arguments) == len(value) and all(map(accepts, arguments, value))


def _spell(expected: Any) -> str:
    if get_origin(expected) is Literal:
        return "one of " + ", ".join(map(str, get_args(expected)))
    if get_origin(expected) in (Union, types.UnionType):
        return " or ".join(_spell(option) for option in get_args(expected))
    names = {int: "a whole number", float: "a number", bool: "true or false", str: "text", type(None): "null"}
    return names.get(expected, str(expected).replace("collections.abc.", ""))
