"""Small photographs of drawn animals, and the steps run over them one after the other."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from fauna.prepare.mask import MaskStep
from fauna.prepare.record import Record, Rows
from fauna.prepare.settings import Settings, prepare_settings
from fauna.prepare.sources.detect import open_source
from fauna.prepare.steps import build_step
from fauna.prepare.workspace import Workspace

WIDTH, HEIGHT = 200, 150


def animal(left: int, top: int, *, size: int = 60) -> np.ndarray:
    """A body with four legs: the mask."""
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[top : top + size // 2, left : left + size] = True
    for leg in (0, size // 6, 4 * size // 6, 5 * size // 6):
        mask[top + size // 2 : top + size, left + leg : left + leg + size // 10] = True
    return mask


def texture(mask: np.ndarray, seed: int = 0) -> np.ndarray:
    """A sharp picture in which animals are brown."""
    rng = np.random.default_rng(seed)
    grass = rng.integers(40, 120, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    fur = (rng.integers(100, 220, (HEIGHT, WIDTH, 1)) * [1.0, 0.7, 0.4]).astype(np.uint8)
    return np.where(mask[..., None], fur, grass).astype(np.uint8)


def put(folder: Path, name: str, mask: np.ndarray, seed: int = 0, *, beside: bool = True) -> Path:
    """A photograph as PNG with its mask beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    Image.fromarray(texture(mask, seed)).save(folder / f"{name}.png")
    if beside:
        Image.fromarray(mask.astype(np.uint8) * np.uint8(255)).save(folder / f"{name}_mask.png")
    return folder / f"{name}.png"


def items(folder: Path, entries: list[dict], names: tuple[str, ...] = ("left_eye", "tailbase")) -> None:
    """An annotation file."""
    (folder / "annotations.json").write_text(json.dumps({"keypoint_names": names, "items": entries}))


def opened(folder: Path, *words: str) -> tuple[Settings, Workspace]:
    """Settings and folders for ``folder/in``."""
    return prepare_settings(list(words)), Workspace(folder / "in", folder / "set", folder / "set.work")


def through(
    folder: Path, *words: str, steps: tuple[str, ...] = ("scan", "mask", "crop", "filter"), segmenter: object = None
) -> list[Rows]:
    """Every photograph's rows after the steps, in the order of the source."""
    settings, workspace = opened(folder, *words)
    made = [build_step(name, settings, workspace) for name in steps]
    for step in made:
        if segmenter is not None and isinstance(step, MaskStep):
            step.__dict__["segmenter"] = segmenter
    found = []
    for rows in open_source(settings, workspace).photos():
        for step in made:
            rows = step(rows)
            assert all(path.is_file() for path in step.outputs(rows))
        found.append(rows)
    return found


def flat(photos: list[Rows]) -> list[Record]:
    """All rows."""
    return [row for rows in photos for row in rows]


def with_override(row: Record, verdict: str) -> Record:
    """As the list of overrides marks it."""
    return replace(row, override=verdict)
