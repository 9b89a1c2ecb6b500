"""Small sets and a step of our own, for tests of what surrounds the steps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from fauna.prepare.record import Rows
from fauna.prepare.steps import Step
from fauna.prepare.workspace import Workspace, write_file

QUICK = (
    "features.encoder=tiny", "features.grid=8", "crop.size=32", "filter.min_extent=null", "filter.min_sharpness=null", "filter.max_truncation=null",
    "split.few_shot_val=2", "mask.segmenter=none",
)  # fmt: skip
"""Settings for small pictures of noise."""


def photographs(folder: Path, species: dict[str, int], size: int = 48) -> Path:
    """Folders of noise, each picture with an ellipse as its mask beside it."""
    rows, columns = np.mgrid[:size, :size] / size - 0.5
    for name, count in species.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        for number in range(count):
            rng = np.random.default_rng([sum(name.encode()), number])
            coarse = Image.fromarray(rng.integers(0, 255, (8, 8, 3), dtype=np.uint8))
            coarse.resize((size, size), Image.Resampling.BICUBIC).save(folder / name / f"{number:03d}.png")
            mask = (rows / 0.3) ** 2 + (columns / 0.4) ** 2 < 1
            Image.fromarray(mask.astype(np.uint8) * 255).save(folder / name / f"{number:03d}_mask.png")
    return folder


class Stamping(Step):
    """Writes a file for every photograph and counts its calls.

    Args:
        workspace: the folders.
        key: of the step.
        fail_at: call at which it raises instead, from 1.
    """

    name = "mask"

    def __init__(self, workspace: Workspace, key: str = "k", fail_at: int | None = None) -> None:
        self.workspace, self._key, self.fail_at = workspace, key, fail_at
        self.calls: list[str] = []

    @property
    def key(self) -> str:
        return self._key

    def outputs(self, rows: Rows) -> list[Path]:
        return [self.workspace.mask(row.id) for row in rows if row.ok]

    def __call__(self, rows: Rows) -> Rows:
        self.calls.append(rows[0].source)
        if len(self.calls) == self.fail_at:
            raise OSError(28, "No space left on device")
        for row in rows:
            write_file(self.workspace.mask(row.id), f"{row.id}{self._key}".encode())
        return tuple(replace(row, mask_source=self._key) for row in rows)
