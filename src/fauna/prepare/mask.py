"""The mask step: the animals of a photograph, from given masks, its alpha channel, or a segmenter."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from fauna.data.readers.crop import widen_box
from fauna.masks.animals import split_animals
from fauna.masks.base import Segmenter
from fauna.masks.boxes import overlap
from fauna.prepare.masks_given import given_file, has_parts, holds_one, read_given
from fauna.prepare.masks_stored import encode_mask, read_mask
from fauna.prepare.overrides import read_overrides
from fauna.prepare.pictures import open_photograph
from fauna.prepare.record import Box, Record, Rows, row_id
from fauna.prepare.settings import Settings, digest
from fauna.prepare.steps import Step
from fauna.prepare.workspace import Workspace, write_file
from fauna.reconstruct.mask_files import alpha_mask
from fauna.reconstruct.photograph import Photograph
from fauna.reconstruct.settings import default_settings
from fauna.reconstruct.status import Refused

VERSION = 2
NONE = "none"
"""``mask.segmenter`` for sets in which every photograph brings its mask."""
MOST_ROWS = 100
"""Of a photograph: the number of an animal has two digits."""

Mask = Bool[np.ndarray, "height width"]


@dataclass(frozen=True)
class Found:
    """What the mask of a row shows.

    Attributes:
        animals: masks at working size, largest first, at least one.
        source: ``given``, ``alpha`` or the segmenter's name.
        notes: of :data:`fauna.prepare.reasons.NOTES`.
    """

    animals: list[Mask]
    source: str
    notes: tuple[str, ...]


class MaskStep(Step):
    """Finds the animals and stores a mask of each at working size.

    In this order: the annotated mask, files beside the photograph, the alpha channel; then the segmenter, which is shown the annotated
    box or the detector's boxes where there are any. Annotated animals stay one each; other masks are split into their animals, and each
    further one becomes a row of its own.

    Args:
        settings: group ``mask``.
        workspace: where masks go.
    """

    name = "mask"

    def __init__(self, *, settings: Settings, workspace: Workspace) -> None:
        self.settings = settings
        self.workspace = workspace
        path = settings.overrides
        self.overrides = read_overrides(None if path is None else Path(path))
        usual = default_settings().mask
        own = settings.mask
        self.limits = replace(
            usual,
            max_pixels=own.max_pixels,
            max_animals=MOST_ROWS,
            alpha_shares=own.alpha_shares,
            alpha_decided=own.alpha_decided,
        )

    @property
    def key(self) -> str:
        """Of the settings, those of the segmenter and what a photograph is."""
        return digest(VERSION, self.settings.mask, self.settings.photo, self.limits)

    @cached_property
    def segmenter(self) -> Segmenter:
        """Loaded when the first photograph needs it."""
        from fauna.masks.grabcut import GrabCut
        from fauna.masks.registry import build_segmenter
        from fauna.prepare.encoders import encoder_by_name

        encoder = encoder_by_name(self.settings.mask.encoder)
        guide = GrabCut(encoder=encoder, saliency=self.limits.saliency, options=self.limits.grabcut)
        return build_segmenter(self.settings.mask.segmenter, guide)

    @cached_property
    def detector(self):
        """Loaded when the first photograph needs it; ``None`` without one."""
        if self.settings.mask.detector is None:
            return None
        from fauna.masks.detector import Detector

        return Detector(weights=self.settings.mask.detector, score=self.settings.mask.detector_score)

    def __call__(self, rows: Rows) -> Rows:
        """The rows with masks, and a row for each further animal."""
        first = next((row for row in rows if row.ok), None)
        if first is None:
            return rows
        try:
            photograph = open_photograph(first, self.settings, self.workspace)
        except Refused as refusal:
            return tuple(row.rejected(self.name, refusal.status) if row.ok else row for row in rows)
        done: list[Record] = []
        further: list[Record] = []
        free = max(row.instance for row in rows) + 1
        for row in rows:
            masked, *more = self._masked(row, photograph, free + len(further)) if row.ok else [row]
            done.append(masked)
            further += more
        return (*done, *further)

    def stamp(self, rows: Rows) -> str:
        """Sizes and times of the given masks' files, and the verdicts on the photograph's animals."""
        given = "|".join(self._stamp(row.given_mask) for row in rows if row.given_mask is not None)
        return given + self.overrides.about(rows[0])

    def _stamp(self, text: str) -> str:
        path = given_file(text, self.workspace)
        if path is None:
            return ""
        try:
            found = path.stat()
        except (OSError, ValueError):  # no file has a null byte in its name
            return "absent"
        return f"{found.st_size}:{found.st_mtime_ns}"

    def outputs(self, rows: Rows) -> list[Path]:
        """The masks of rows that are ok."""
        return [self.workspace.mask(row.id) for row in rows if row.ok and row.mask_source is not None]

    def _masked(self, row: Record, photograph: Photograph, free: int) -> list[Record]:
        try:
            found = self._find(row, photograph)
        except Refused as refusal:
            return [row.rejected(self.name, refusal.status)]
        except _NoMask:
            return [row.rejected(self.name, "no_mask")]
        row = row.with_notes(*found.notes)
        if len(found.animals) > 1:
            row = row.with_notes("several_animals")
        rows = [self._on_box(row, self._kept(row, found.animals[0], photograph, found.source))]
        for place, animal in enumerate(found.animals[1 : MOST_ROWS - free + 1]):
            instance = free + place
            other = replace(row, id=row_id(row.photo, instance), instance=instance, box=None, keypoints=None)
            other = replace(other, override=self.overrides.of(other))
            if place + 1 >= self.settings.mask.max_animals:
                other = other.rejected(self.name, "more_animals")
            rows.append(self._kept(other, animal, photograph, found.source) if other.ok else other)
        return rows

    def _on_box(self, row: Record, masked: Record) -> Record:
        """Rejected when the segmenter was shown an annotated box and found something else in it."""
        if "mask_from_box" not in masked.notes or row.box is None:
            return masked
        mask = read_mask(self.workspace.mask(row.id))
        found = mask_box(mask, (masked.width or mask.shape[1]) / mask.shape[1])
        return (
            masked.rejected(self.name, "off_box")
            if overlap(found, row.box) < self.settings.mask.min_box_iou
            else masked
        )

    def _kept(self, row: Record, mask: Mask, photograph: Photograph, source: str) -> Record:
        write_file(self.workspace.mask(row.id), encode_mask(mask))
        box = row.box if row.box is not None else mask_box(mask, photograph.scale)
        return replace(row, mask_source=source, box=box)

    def _find(self, row: Record, photograph: Photograph) -> Found:
        """The animals of a row; raises Refused where there is none."""
        masks, source, notes = self._masks(row, photograph)
        masks = [mask for mask in masks if mask.any()]
        one = row.given_mask is not None and holds_one(row.given_mask)
        whole = row.given_mask is not None and not has_parts(row.given_mask)
        animals = masks if whole else [animal for mask in masks for animal in self._split(mask)]
        if not animals:
            raise Refused("no_animal", f"{row.id}: expected an animal, got an empty mask; give a mask of the animal")
        if row.box is not None or one:
            animals = [np.logical_or.reduce(animals)]
        return Found(sorted(animals, key=lambda animal: -int(animal.sum())), source, notes)

    def _split(self, mask: Mask) -> list[Mask]:
        own = self.settings.mask
        return split_animals(mask, animal_share=own.animal_share, speck_share=own.speck_share, same_gap=own.same_gap)

    def _masks(self, row: Record, photograph: Photograph) -> tuple[list[Mask], str, tuple[str, ...]]:
        if row.given_mask is not None:
            found = read_given(row.given_mask, photograph, self.workspace, self.limits, annotated=row.annotated_size)
            return list(found.masks), "given", found.flags
        notes: tuple[str, ...] = ()
        if photograph.alpha is not None:
            found = alpha_mask(photograph, self.limits)
            if found is not None:
                return list(found.masks), "alpha", found.flags
            notes = ("alpha_ignored",)
        if self.settings.mask.segmenter == NONE:
            raise _NoMask
        masks = list(self._segmented(row, photograph))
        shown = ("mask_from_box",) if row.box is not None else ()
        return masks, self.segmenter.name, (*notes, *shown, *self.segmenter.flags)

    def _segmented(self, row: Record, photograph: Photograph) -> Iterator[Mask]:
        """By the annotated box, else by the detector's boxes, else of the whole photograph."""
        image, scale = photograph.image, photograph.scale
        if row.box is not None:
            yield self.segmenter.segment_in(image, _scaled(widen_box(row.box, self.settings.mask.box_margin), scale))
        elif self.detector is not None:
            for box in self.detector.boxes(image, row.species):
                yield self.segmenter.segment_in(image, box)
        else:
            yield self.segmenter.segment(image)


class _NoMask(Exception):
    """No mask was given, and there is no segmenter to ask."""


def mask_box(mask: Mask, scale: float) -> Box:
    """Left, top, right, bottom of a mask, which is not empty, in pixels of the photograph.

    >>> mask = np.zeros((4, 6), bool)
    >>> mask[1:3, 2:5] = True
    >>> mask_box(mask, 2.0)
    (4.0, 2.0, 10.0, 6.0)
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    sides = (columns[0], rows[0], columns[-1] + 1, rows[-1] + 1)
    left, top, right, bottom = (float(side) * scale for side in sides)
    return left, top, right, bottom


def _scaled(box: Box, scale: float) -> Box:
    left, top, right, bottom = box
    return left / scale, top / scale, right / scale, bottom / scale
