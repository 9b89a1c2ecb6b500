"""The numbers of ``conf/prepare.yaml`` as frozen dataclasses; needs neither Hydra nor torch."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import yaml
from omegaconf import OmegaConf

from fauna._conf import CONF_DIR
from fauna.errors import FaunaError
from fauna.prepare.limits import RULES, Number, check_values
from fauna.reconstruct.settings import PhotoSettings
from fauna.yaml_groups import build_group

FILE = "prepare.yaml"
WORDS = ("work", "shard", "overrides", "split.back_views", "source.images", "source.name")
"""Keys whose values are words though they may look like numbers: a folder may be called 7."""


@dataclass(frozen=True)
class SourceSettings:
    """How SOURCE is read; see the comments of the file."""

    kind: str
    name: str | None
    species: str | None
    licence: str | None
    provenance: str | None
    images: str | None
    frames_per_second: float
    max_archive_bytes: int
    min_visibility: float
    rename: tuple[str, ...]


@dataclass(frozen=True)
class DuplicateSettings:
    """When two pictures are one, in bits of 64 of the perceptual hash."""

    near_bits: int
    same_split_bits: int
    frame_bits: int


@dataclass(frozen=True)
class MaskSettings:
    """Where masks come from, and what of them is an animal; as :class:`fauna.reconstruct.settings.MaskSettings`."""

    segmenter: str
    encoder: str
    detector: str | None
    detector_score: float
    animal_share: float
    speck_share: float
    same_gap: float
    max_animals: int
    max_pixels: int
    box_margin: float
    min_box_iou: float
    alpha_shares: tuple[float, float]
    alpha_decided: float


@dataclass(frozen=True)
class CropSettings:
    """How crops are cut and stored."""

    rule: str
    size: int
    jpeg_quality: int


@dataclass(frozen=True)
class FilterSettings:
    """What is rejected; ``None`` switches a test off."""

    min_extent: int | None
    min_sharpness: float | None
    max_truncation: float | None
    max_occlusion: float | None
    min_fill: float | None
    max_fill: float | None
    max_parts: int | None
    speck_share: float
    border: float


@dataclass(frozen=True)
class SheetSettings:
    """Contact sheets for people."""

    cell: int
    columns: int
    per_reason: int
    per_species: int


@dataclass(frozen=True)
class FeatureSettings:
    """Feature maps that are stored with the crops."""

    encoder: str | None
    grid: int | None
    channels: int
    fit_photos: int
    seed: int


@dataclass(frozen=True)
class SplitSettings:
    """Who is trained on."""

    seed: int
    few_shot_below: int
    few_shot_val: int
    few_shot_test: int
    val_fraction: float
    test_fraction: float
    min_train: int
    min_photos: int
    held_out: tuple[str, ...]
    back_views: str | None


@dataclass(frozen=True)
class CheckSettings:
    """What an audit says about unlicensed photographs."""

    unlicensed: str


@dataclass(frozen=True)
class PackSettings:
    """How large sets are packed."""

    shard_bytes: int


@dataclass(frozen=True)
class Settings:
    """Everything ``conf/prepare.yaml`` says."""

    work: str | None
    shard: str | None
    shards: int
    runner: str
    manifest_rows: int
    overrides: str | None
    source: SourceSettings
    photo: PhotoSettings
    duplicates: DuplicateSettings
    mask: MaskSettings
    crop: CropSettings
    filter: FilterSettings
    sheets: SheetSettings
    features: FeatureSettings
    split: SplitSettings
    check: CheckSettings
    pack: PackSettings

    def __post_init__(self) -> None:
        check_values(asdict(self))


def prepare_settings(overrides: Sequence[str]) -> Settings:
    """The settings of ``conf/prepare.yaml`` with what a command line changes.

    Args:
        overrides: ``key=value`` each, e.g. ``crop.size=512``.

    Raises:
        FaunaError: for a word that is none, an unknown key, or a value that does not fit.
    """
    content = yaml.safe_load((CONF_DIR / FILE).read_text(encoding="utf-8"))
    for word in overrides:
        key, equals, text = word.partition("=")
        if not equals or not key:
            raise FaunaError(f"{word}: expected key=value, got something else; e.g. crop.size=512")
        _set(content, key.split("."), key, _value(key, text))
    check_values(content)  # before lists become tuples: a word that should be a list is still one
    return build_group(Settings, content, file=FILE)


def digest(*parts: Any) -> str:
    """16 hexadecimal digits of settings (dataclasses) and plain values."""
    plain = [asdict(part) if hasattr(part, "__dataclass_fields__") else part for part in parts]
    return hashlib.blake2b(json.dumps(plain, sort_keys=True).encode(), digest_size=8).hexdigest()


def _value(key: str, text: str) -> Any:
    try:
        value = OmegaConf.to_container(OmegaConf.from_dotlist([f"value={text}"]))
    except Exception as error:  # YAML and OmegaConf raise several kinds
        raise FaunaError(f"{key}: expected a plain value, got {text!r}; put it in quotes") from error
    assert isinstance(value, dict)
    return value["value"]


def _set(content: dict[str, Any], path: list[str], key: str, value: Any) -> None:
    *groups, name = path
    node: Any = content
    for group in groups:
        node = node.get(group) if isinstance(node, dict) else None
    if not isinstance(node, dict) or name not in node or isinstance(node[name], dict):
        raise FaunaError(f"{key}: expected a key of conf/{FILE}, got an unknown one; see docs/prepare.md")
    rule = RULES[key]
    if key in WORDS and isinstance(value, (int, float)) and not isinstance(value, bool):
        value = str(value)
    if isinstance(rule, Number) and not rule.whole and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    node[name] = value
