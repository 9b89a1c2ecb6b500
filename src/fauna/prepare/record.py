"""One row of the manifest: an animal of a photograph, and everything that is known about it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

Status = Literal["ok", "rejected"]
Point = tuple[float, float, float]
Box = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Record:
    """An animal of a photograph. Places are pixels of the upright photograph at full size, 0 is the left or top edge.

    Attributes:
        id: ``<photo>_<instance, two digits>``; the first part of its files' names.
        photo: 16 hexadecimal digits, a digest of data set, path and frame: known without opening the file.
        instance: number of the animal in its photograph.
        dataset: name of the set it comes from.
        source: the file below SOURCE, with forward slashes (:func:`fauna.prepare.workspace.text_of_path`).
        frame: of a video file, from 0; or the number in the name of a frame of a video's folder; ``None`` for photographs.
        species: name of its folder in DEST; lower case letters, digits and ``_``.
        group: photograph or video that the file belongs to; decides the shard.
        origin: annotation file and entry, for messages.
        licence: as the source states it, ``unknown`` without a statement.
        provenance: where it comes from: data set, author, address.
        annotated_size: (width, height) according to the annotation.
        box: of the animal (left, top, right, bottom): annotated, else of the mask once there is one.
        given_mask: where an annotated mask is, as :mod:`fauna.prepare.masks_given` writes it; ``None`` without.
        keypoints: (x, y, 1 where annotated) in the order of the set's names, ``None`` without.
        sha256: of the file (of the pixels for a frame of a video file).
        phash: perceptual hash of the upright picture, 16 hexadecimal digits.
        format: of the file, e.g. ``JPEG``.
        width: of the upright photograph.
        height: likewise.
        orientation: EXIF tag by which it was turned, 1 for none.
        exif: JSON of the few tags that are kept (no place), ``None`` without any.
        mask_source: ``given``, ``alpha``, or the segmenter's name.
        window: (left, top, side) of the crop.
        sharpness: variance of the Laplacian on the animal, crop at its final size, 8-bit grey levels squared.
        fill: share of the crop that is animal.
        truncation: share of the bounding box's circumference that lies on the photograph's border.
        occlusion: 1 - share of the mask in its largest connected part, after closing nothing: what something in front cut off.
        parts: connected parts of the mask that are not specks.
        rgb_sha256: of the crop's file.
        mask_sha256: of its mask's file.
        feat_sha256: of its feature map's file.
        duplicate_of: id of the photo (or frame) that it repeats.
        cluster: smallest photo id of all that must stay in one split; :attr:`group` and near duplicates joined.
        split: ``train``, ``val``, ``test`` or ``back`` (back views, training only).
        override: ``keep`` or ``drop`` of the list of overrides.
        status: ``ok`` while the row goes on.
        reasons: ``step:reason`` of :data:`fauna.prepare.reasons.REASONS`, all that speak against it, also when overridden.
        notes: of :data:`fauna.prepare.reasons.NOTES`: nothing against it.
    """

    id: str
    photo: str
    instance: int
    dataset: str
    source: str
    species: str
    group: str
    frame: int | None = None
    origin: str | None = None
    licence: str = "unknown"
    provenance: str | None = None
    annotated_size: tuple[int, int] | None = None
    box: Box | None = None
    given_mask: str | None = None
    keypoints: tuple[Point, ...] | None = None
    sha256: str | None = None
    phash: str | None = None
    format: str | None = None
    width: int | None = None
    height: int | None = None
    orientation: int | None = None
    exif: str | None = None
    mask_source: str | None = None
    window: tuple[float, float, float] | None = None
    sharpness: float | None = None
    fill: float | None = None
    truncation: float | None = None
    occlusion: float | None = None
    parts: int | None = None
    rgb_sha256: str | None = None
    mask_sha256: str | None = None
    feat_sha256: str | None = None
    duplicate_of: str | None = None
    cluster: str | None = None
    split: str | None = None
    override: str | None = None
    status: Status = "ok"
    reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether the row goes on to the next step."""
        return self.status == "ok"

    def rejected(self, step: str, *reasons: str, **facts: Any) -> "Record":
        """The row with reasons against it, which take it out unless it is to be kept and they can be overridden.

        Args:
            step: that found them.
            reasons: of :data:`fauna.prepare.reasons.REASONS`.
            facts: further fields to set.
        """
        from fauna.prepare.reasons import REASONS

        named = tuple(f"{step}:{reason}" for reason in reasons)
        final = [reason for reason in reasons if self.override != "keep" or not REASONS[reason].can_be_overridden]
        status: Status = "rejected" if final or not self.ok else "ok"
        return replace(self, reasons=(*self.reasons, *named), status=status, **facts)

    def with_notes(self, *notes: str) -> "Record":
        """The row with further notes, each once."""
        return replace(self, notes=tuple(dict.fromkeys((*self.notes, *notes))))

    def as_json(self) -> str:
        """One line: every field, lists for tuples."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return json.dumps(values, separators=(",", ":"), ensure_ascii=True, allow_nan=False)

    @staticmethod
    def from_values(values: Mapping[str, Any]) -> "Record":
        """The row of plain values: lists become tuples, all the way down."""
        return Record(**{name: _tuples(value) for name, value in values.items()})


Rows = tuple[Record, ...]
"""The rows of one photograph, by instance: what a step works on, and what is committed at once."""


def photo_id(dataset: str, source: str, frame: int | None) -> str:
    """16 hexadecimal digits that name a photograph or frame, whatever its content.

    >>> photo_id("mine", "horse/1.jpg", None)
    'e99239fe67305546'
    """
    text = f"{dataset}\0{source}\0{'' if frame is None else frame}"
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def row_id(photo: str, instance: int) -> str:
    """Name of an animal and of its files.

    >>> row_id("aa", 3)
    'aa_03'
    """
    return f"{photo}_{instance:02d}"


def _tuples(value: Any) -> Any:
    return tuple(_tuples(each) for each in value) if isinstance(value, list) else value
