"""The filter step: measures every crop and rejects those that would teach nothing good, each with every reason against it."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from fauna.data.photo_files import decode_image
from fauna.data.photos import MASK_THRESHOLD
from fauna.prepare.masks_stored import read_mask
from fauna.prepare.measures import Measures, measure
from fauna.prepare.record import Record, Rows
from fauna.prepare.settings import FilterSettings, Settings, digest
from fauna.prepare.steps import Step
from fauna.prepare.workspace import Workspace

VERSION = 1


class FilterStep(Step):
    """Measures and rejects; writes no file.

    Args:
        settings: group ``filter``.
        workspace: where masks and crops are.
    """

    name = "filter"

    def __init__(self, *, settings: Settings, workspace: Workspace) -> None:
        self.settings = settings
        self.workspace = workspace

    @property
    def key(self) -> str:
        """Of the settings."""
        return digest(VERSION, self.settings.filter)

    def __call__(self, rows: Rows) -> Rows:
        """The rows with what was measured, and every reason against them."""
        return tuple(self._judged(row) if row.ok else row for row in rows)

    def outputs(self, rows: Rows) -> list[Path]:
        """None."""
        del rows
        return []

    def _judged(self, row: Record) -> Record:
        image = decode_image(self.workspace.crop(row.id, "rgb.jpg"), "RGB")
        small = decode_image(self.workspace.crop(row.id, "mask.png"), "L") > MASK_THRESHOLD
        mask = read_mask(self.workspace.mask(row.id))
        scale = (row.width or mask.shape[1]) / mask.shape[1]
        own = self.settings.filter
        found = measure(image, np.asarray(small), mask, scale=scale, speck_share=own.speck_share, border=own.border)
        row = replace(
            row,
            sharpness=round(found.sharpness, 3),
            fill=round(found.fill, 6),
            truncation=round(found.truncation, 6),
            occlusion=round(found.occlusion, 6),
            parts=found.parts,
        )
        against = [*objections(found, own), *(["dropped"] if row.override == "drop" else [])]
        return row.rejected(self.name, *against) if against else row


def objections(found: Measures, limits: FilterSettings) -> Iterator[str]:
    """Words of :data:`fauna.prepare.reasons.REASONS` that speak against an animal."""
    if limits.min_extent is not None and found.extent < limits.min_extent:
        yield "small_animal"
    if limits.min_sharpness is not None and found.sharpness < limits.min_sharpness:
        yield "blurred"
    if limits.max_truncation is not None and found.truncation > limits.max_truncation:
        yield "truncated"
    pieces = limits.max_parts is not None and found.parts > limits.max_parts
    if pieces or (limits.max_occlusion is not None and found.occlusion > limits.max_occlusion):
        yield "occluded"
    if limits.min_fill is not None and found.fill < limits.min_fill:
        yield "low_fill"
    if limits.max_fill is not None and found.fill > limits.max_fill:
        yield "high_fill"
