"""What a queue consists of: rows of a table, each trained with some seeds and evaluated in some ways."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from fauna._conf import CONF_DIR
from fauna.errors import FaunaError

FOLDER = "queue"
"""Of the configuration, where the queues lie."""


@dataclass(frozen=True)
class Run:
    """One training.

    Attributes:
        row: name of its row.
        seed: of the training.
        overrides: what the row changes.
    """

    row: str
    seed: int
    overrides: tuple[str, ...]

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.row}-{self.seed}"


@dataclass(frozen=True)
class Plan:
    """A queue.

    Attributes:
        experiment: what all runs start from.
        common: overrides of all runs.
        rows: overrides of each row; the others are compared with the first.
        seeds: of every row.
        more_seeds: further ones of some rows.
        evaluations: words for ``fauna-eval`` by the name of the evaluation.
        groups: species with columns of their own, by name.
        metrics: columns of the table.
    """

    experiment: str
    common: Sequence[str]
    rows: Mapping[str, Sequence[str]]
    seeds: Sequence[int]
    more_seeds: Mapping[str, Sequence[int]]
    evaluations: Mapping[str, Sequence[str]]
    groups: Mapping[str, Sequence[str]]
    metrics: Sequence[str]

    def runs(self) -> tuple[Run, ...]:
        """In the order of their importance: every row with the first seeds, then what the further seeds add."""
        order = [(row, seed) for seed in self.seeds for row in self.rows]
        further = sorted({seed for seeds in self.more_seeds.values() for seed in seeds})
        order += [(row, seed) for seed in further for row in self.rows if seed in self.more_seeds.get(row, ())]
        return tuple(Run(row, seed, (*self.common, *self.rows[row])) for row, seed in dict.fromkeys(order))


def read_plan(name: str, changes: Sequence[str]) -> Plan:
    """Read ``conf/queue/NAME.yaml``, or the file ``name``, and change it.

    Args:
        name: of a queue of the project, or a path that ends with ``.yaml``.
        changes: ``key=value`` for any key of it, e.g. ``evaluations.real=[data=fauna,data.root=FOLDER]``; lists of words need no quotes.

    Raises:
        FaunaError: for an unknown queue or key, or a value of another kind.
    """
    path = Path(name) if name.endswith(".yaml") else CONF_DIR / FOLDER / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(file.stem for file in (CONF_DIR / FOLDER).glob("*.yaml")))
        raise FaunaError(
            f"fauna-queue: expected one of {known}, or a .yaml file, got {name!r}; give the name of a queue"
        )
    try:
        content = OmegaConf.to_container(OmegaConf.merge(OmegaConf.load(path), _changes(changes)))
        return _checked(content)
    except (OmegaConfBaseException, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise FaunaError(
            f"fauna-queue: expected a queue as in conf/{FOLDER}/ablation.yaml, got {reason}; mend {path}"
        ) from error


def _changes(words: Sequence[str]) -> Any:
    pairs = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or key.split(".")[0] not in Plan.__dataclass_fields__:
            keys = ", ".join(["out", "table", *Plan.__dataclass_fields__])
            raise FaunaError(f"fauna-queue: expected key=value with a key among {keys}, got {word!r}; mend it")
        listed = value.startswith("[") and value.endswith("]")
        pairs[key] = _words(value[1:-1]) if listed else value
    result = OmegaConf.create()
    for key, value in pairs.items():
        OmegaConf.update(
            result, key, [int(v) if v.isdigit() else v for v in value] if isinstance(value, list) else value
        )
    return result


def _words(text: str) -> list[str]:
    """Split at commas that stand outside brackets."""
    words, depth = [""], 0
    for letter in text:
        depth += (letter in "[{(") - (letter in "]})")
        if letter == "," and depth == 0:
            words.append("")
        else:
            words[-1] += letter
    return [word.strip() for word in words if word.strip()]


def _checked(content: Any) -> Plan:
    if not isinstance(content, dict):
        raise ValueError(f"{type(content).__name__} where keys and values belong")
    empty = {"common": [], "more_seeds": {}, "groups": {}}
    plan = Plan(**{**content, **{key: empty[key] for key in empty if content.get(key) is None}})
    if not isinstance(plan.experiment, str):
        raise ValueError(f"experiment = {plan.experiment!r} where the name of an experiment belongs")
    for key in ("rows", "evaluations", "groups", "more_seeds"):
        if not isinstance(getattr(plan, key), dict):
            raise ValueError(f"{key} = {getattr(plan, key)!r} where names with lists belong")
    if not plan.rows or not plan.evaluations:
        raise ValueError("no rows or no evaluations")
    named = {
        f"{key}.{name}": words
        for key in ("rows", "evaluations", "groups")
        for name, words in getattr(plan, key).items()
    }
    for key, words in {"common": plan.common, "metrics": plan.metrics, **named}.items():
        if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
            raise ValueError(f"{key} = {words!r} where a list of words belongs")
    changes = {"common": plan.common, **{key: words for key, words in named.items() if not key.startswith("groups.")}}
    for key, words in changes.items():
        if wrong := [word for word in words if "=" not in word and not word.startswith("~")]:
            raise ValueError(f"{key} with {wrong[0]!r}, where KEY=VALUE belongs")
    for name in (*plan.rows, *plan.evaluations):
        if not isinstance(name, str) or not re.fullmatch(r"\w[\w.+-]*", name):
            raise ValueError(f"{name!r} where a row's or an evaluation's name belongs, of letters, digits, _, . and -")
    if set(plan.more_seeds) - set(plan.rows):
        raise ValueError(f"more_seeds of {', '.join(map(str, plan.more_seeds))}, where names of rows belong")
    for seeds in (plan.seeds, *plan.more_seeds.values()):
        if not isinstance(seeds, list) or not all(
            isinstance(seed, int) and seed is not True and seed is not False and seed >= 0 for seed in seeds
        ):
            raise ValueError(f"seeds {seeds!r}, where a list of whole numbers belongs")
    if without := [row for row in plan.rows if not plan.seeds and not plan.more_seeds.get(row)]:
        raise ValueError(f"no seeds for {', '.join(without)}")
    return plan
