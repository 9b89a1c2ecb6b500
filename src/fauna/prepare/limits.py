"""What every setting of ``conf/prepare.yaml`` may be: one table, one line for whatever does not fit."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fauna.errors import FaunaError
from fauna.prepare.shard import parse_shard

BIG = 10**15


@dataclass(frozen=True)
class Number:
    """A number in [low, high].

    Attributes:
        low: smallest.
        high: largest.
        whole: whether it has no fraction.
        null: whether ``null`` will do.
    """

    low: float | int
    high: float | int
    whole: bool = False
    null: bool = False

    def __str__(self) -> str:
        if self.low == self.high:
            return _plain(self.low)
        kind = "a whole number" if self.whole else "a number"
        return f"{kind} from {_plain(self.low)} to {_plain(self.high)}{' or null' if self.null else ''}"

    def fits(self, value: object) -> bool:
        """Whether a value is such a number."""
        if isinstance(value, bool) or not isinstance(value, int if self.whole else (int, float)):
            return value is None and self.null
        return math.isfinite(value) and self.low <= value <= self.high


@dataclass(frozen=True)
class Text:
    """A word that is not empty.

    Attributes:
        null: whether ``null`` will do.
        choices: that there are; empty for any word.
    """

    null: bool = False
    choices: tuple[str, ...] = ()

    def __str__(self) -> str:
        words = f"one of {', '.join(self.choices)}" if self.choices else "a name that is not empty"
        return f"{words}{' or null' if self.null else ''}"

    def fits(self, value: object) -> bool:
        """Whether a value is such a word."""
        if not isinstance(value, str):
            return value is None and self.null
        return bool(value.strip()) and "\0" not in value and (not self.choices or value in self.choices)


@dataclass(frozen=True)
class Names:
    """A list of words; ``example`` is one."""

    example: str

    def __str__(self) -> str:
        return f"a list of names such as {self.example}"

    def fits(self, value: object) -> bool:
        """Whether a value is such a list."""
        return isinstance(value, (list, tuple)) and all(isinstance(each, str) and each.strip() for each in value)


@dataclass(frozen=True)
class Span:
    """Two shares, the smaller one first."""

    def __str__(self) -> str:
        return "two shares from 0 to 1, the smaller one first"

    def fits(self, value: object) -> bool:
        """Whether a value is such a pair."""
        share = Number(0, 1)
        return (
            isinstance(value, (list, tuple))
            and len(value) == 2
            and all(map(share.fits, value))
            and value[0] <= value[1]
        )


Rule = Number | Text | Names | Span


def _whole(low: int, high: int, *, null: bool = False) -> Number:
    return Number(low, high, whole=True, null=null)


SHARE, PERHAPS_SHARE = Number(0, 1), Number(0, 1, null=True)
WORD, PERHAPS_WORD = Text(), Text(null=True)
SEED = _whole(0, 2**63 - 1)

RULES: Mapping[str, Rule] = {
    "work": PERHAPS_WORD,
    "shard": PERHAPS_WORD,
    "shards": _whole(1, 99_999),
    "runner": Text(choices=("local", "ray")),
    "manifest_rows": _whole(1, 10**9),
    "overrides": PERHAPS_WORD,
    "source.kind": WORD,
    "source.name": PERHAPS_WORD,
    "source.species": PERHAPS_WORD,
    "source.licence": PERHAPS_WORD,
    "source.provenance": PERHAPS_WORD,
    "source.images": PERHAPS_WORD,
    "source.frames_per_second": Number(0.001, 1000),
    "source.max_archive_bytes": _whole(1, BIG),
    "source.min_visibility": Number(0, 10),
    "source.rename": Names("[libby:cat]"),
    "photo.max_bytes": _whole(1, 10**10),
    "photo.max_pixels": _whole(1, 10**10),
    "photo.max_pixels_jpeg": _whole(1, 10**10),
    "photo.max_pixels_progressive": _whole(1, 10**10),
    "photo.min_side": _whole(1, 10_000),
    "photo.work_side": _whole(64, 16_384),
    "duplicates.near_bits": _whole(0, 15),
    "duplicates.same_split_bits": _whole(0, 15),
    "duplicates.frame_bits": _whole(0, 15),
    "mask.segmenter": WORD,
    "mask.encoder": WORD,
    "mask.detector": PERHAPS_WORD,
    "mask.detector_score": SHARE,
    "mask.animal_share": SHARE,
    "mask.speck_share": SHARE,
    "mask.same_gap": Number(0, 10),
    "mask.max_animals": _whole(1, 100),
    "mask.max_pixels": _whole(1, 10**10),
    "mask.box_margin": Number(0, 10),
    "mask.min_box_iou": SHARE,
    "mask.alpha_shares": Span(),
    "mask.alpha_decided": SHARE,
    "crop.rule": Text(choices=("widen", "fauna")),
    "crop.size": _whole(32, 2048),
    "crop.jpeg_quality": _whole(1, 100),
    "filter.min_extent": _whole(0, 100_000, null=True),
    "filter.min_sharpness": Number(0, 10**9, null=True),
    "filter.max_truncation": PERHAPS_SHARE,
    "filter.max_occlusion": PERHAPS_SHARE,
    "filter.min_fill": PERHAPS_SHARE,
    "filter.max_fill": PERHAPS_SHARE,
    "filter.max_parts": _whole(1, 10_000, null=True),
    "filter.speck_share": SHARE,
    "filter.border": Number(0, 0.5),
    "sheets.cell": _whole(16, 1024),
    "sheets.columns": _whole(1, 100),
    "sheets.per_reason": _whole(0, 10_000),
    "sheets.per_species": _whole(0, 10_000),
    "features.encoder": PERHAPS_WORD,
    "features.grid": _whole(1, 256, null=True),
    "features.channels": _whole(16, 16),
    "features.fit_photos": _whole(1, 10**7),
    "features.seed": SEED,
    "split.seed": SEED,
    "split.few_shot_below": _whole(0, BIG),
    "split.few_shot_val": _whole(0, BIG),
    "split.few_shot_test": _whole(0, BIG),
    "split.val_fraction": SHARE,
    "split.test_fraction": SHARE,
    "split.min_train": _whole(0, BIG),
    "split.min_photos": _whole(0, BIG),
    "split.held_out": Names("[okapi]"),
    "split.back_views": PERHAPS_WORD,
    "check.unlicensed": Text(choices=("warn", "fail")),
    "pack.shard_bytes": _whole(1, BIG),
}
"""By key; every key of the file has a rule."""

NOT_ABOVE = (
    ("filter.min_fill", "filter.max_fill"),
    ("mask.speck_share", "mask.animal_share"),
)
"""Pairs of which the first may not be larger."""


def check_values(content: Mapping[str, Any]) -> None:
    """Refuse values that no run could use.

    Args:
        content: of ``conf/prepare.yaml``, with what a command line changed.

    Raises:
        FaunaError: naming the key, what may stand there, and what came.
    """
    values = flattened(content)
    for key, rule in RULES.items():
        value = values[key]
        if not rule.fits(value):
            raise FaunaError(f"{key}: expected {rule}, got {_shown(value)}; {_advice(rule, value)}")
    for low, high in NOT_ABOVE:
        if None not in (values[low], values[high]) and values[low] > values[high]:
            raise FaunaError(f"{low}: expected at most {high}={values[high]}, got {values[low]}; give a smaller one")
    if values["split.val_fraction"] + values["split.test_fraction"] > 1:
        both = f"{values['split.val_fraction']} and {values['split.test_fraction']}"
        raise FaunaError(
            f"split.val_fraction: expected at most 1 with split.test_fraction, got {both}; give smaller ones"
        )
    if any(text.count(":") != 1 or not all(text.split(":")) for text in values["source.rename"]):
        raise FaunaError(
            f"source.rename: expected old:new each, got {_shown(values['source.rename'])}; e.g. [libby:cat]"
        )
    if values["shard"] is not None:
        parse_shard(values["shard"])


def flattened(content: Mapping[str, Any], front: str = "") -> dict[str, Any]:
    """Values by their dotted keys.

    >>> flattened({"a": {"b": 1}, "c": None})
    {'a.b': 1, 'c': None}
    """
    found: dict[str, Any] = {}
    for key, value in content.items():
        name = f"{front}{key}"  # a group of keys, unless a command line gave a map to one
        found |= flattened(value, f"{name}.") if isinstance(value, Mapping) and name not in RULES else {name: value}
    return found


def _advice(rule: Rule, value: object) -> str:
    if isinstance(rule, Names):
        if isinstance(value, str) and value.strip():
            return f"write [{value}]"
        if isinstance(value, (list, tuple)):
            return f"write it as in {rule.example}, numbers in quotes"
    return "give another"


def _shown(value: object) -> str:
    return "nothing" if value is None else repr(list(value) if isinstance(value, tuple) else value)[:80]


def _plain(number: float | int) -> str:
    return f"{number:,}" if isinstance(number, int) else f"{number:g}"
