"""Contact sheets for people: what was rejected, a sheet for each reason, and a sample of what is used."""

import io
from collections import defaultdict
from collections.abc import Iterator, Sequence
from heapq import heappush, heappushpop
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image, ImageDraw, UnidentifiedImageError

from fauna.errors import FaunaError
from fauna.prepare.masks_stored import read_mask
from fauna.prepare.pictures import open_photograph
from fauna.prepare.record import Record
from fauna.prepare.settings import Settings
from fauna.prepare.tables import read_table
from fauna.prepare.workspace import Workspace, write_file
from fauna.reconstruct.status import Refused

CAPTION = 22
"""Pixels below a picture: two lines."""
OUTLINE = (255, 60, 30)
USED = "used"


class Sample:
    """The rows of least id: a choice that is the same however rows are spread over tables, since ids are digests.

    Args:
        size: most rows.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self.count = 0
        self._heap: list[_Latest] = []

    def add(self, row: Record) -> None:
        """Look at a row."""
        self.count += 1
        if len(self._heap) < self.size:
            heappush(self._heap, _Latest(row))
        elif self.size:
            heappushpop(self._heap, _Latest(row))

    @property
    def rows(self) -> list[Record]:
        """Those chosen, by species and id."""
        return sorted((each.row for each in self._heap), key=lambda row: (row.species, row.id))


class _Latest:
    """A row that sorts last id first."""

    def __init__(self, row: Record) -> None:
        self.row = row

    def __lt__(self, other: "_Latest") -> bool:
        return self.row.id > other.row.id


def write_sheets(tables: Sequence[Path], settings: Settings, workspace: Workspace) -> list[Path]:
    """Write ``rejected/<step>-<reason>.png`` and ``used.png`` into the report folder; sheets of reasons that are gone are removed.

    Animals that the list of overrides keeps although something speaks against them are on that reason's sheet too, marked as kept.
    Memory holds the rows and one row of pictures of a sheet.

    Args:
        tables: of all shards after the filter.
        settings: group ``sheets``.
        workspace: folders.

    Returns:
        The files.
    """
    rejected: dict[str, Sample] = defaultdict(lambda: Sample(settings.sheets.per_reason))
    used: dict[str, Sample] = defaultdict(lambda: Sample(settings.sheets.per_species))
    for table in tables:
        for row in read_table(table):
            for reason in row.reasons:
                rejected[reason].add(row)
            if row.ok:
                used[row.species].add(row)
    folder = workspace.report / "rejected"
    files = []
    for reason, sample in sorted(rejected.items()):
        step, word = reason.split(":")
        files.append(folder / f"{step}-{word}.png")
        title = f"{reason}: {sample.count} rows, {len(sample.rows)} shown"
        write_file(files[-1], draw_sheet(title, sample.rows, word, settings, workspace))
    for old in folder.glob("*.png") if folder.is_dir() else ():
        if old not in files:
            old.unlink()
    shown = [row for _, sample in sorted(used.items()) for row in sample.rows]
    if shown:
        files.append(workspace.report / f"{USED}.png")
        title = f"used: {sum(sample.count for sample in used.values())} rows, {len(shown)} shown"
        write_file(files[-1], draw_sheet(title, shown, USED, settings, workspace))
    return files


def draw_sheet(title: str, rows: Sequence[Record], word: str, settings: Settings, workspace: Workspace) -> bytes:
    """A sheet as PNG: crops with the mask's outline, or whole photographs where there is no crop.

    Args:
        title: first line.
        rows: in their order.
        word: the reason, which decides what captions say.
        settings: group ``sheets``.
        workspace: folders.
    """
    cell, columns = settings.sheets.cell, min(settings.sheets.columns, max(len(rows), 1))
    lines = -(-len(rows) // columns)
    sheet = Image.new("RGB", (columns * cell, 18 + lines * (cell + CAPTION)), "white")
    pen = ImageDraw.Draw(sheet)
    pen.text((4, 3), title, fill="black")
    for place, row in enumerate(rows):
        left, top = place % columns * cell, 18 + place // columns * (cell + CAPTION)
        picture = _picture(row, cell, settings, workspace)
        if picture is not None:
            sheet.paste(picture, (left + (cell - picture.width) // 2, top + (cell - picture.height) // 2))
        for number, line in enumerate(_caption(row, word)):
            pen.text((left + 2, top + cell + 10 * number), line[: cell // 6], fill="black")
    buffer = io.BytesIO()
    sheet.save(buffer, "PNG")
    return buffer.getvalue()


def outlined(
    image: UInt8[np.ndarray, "height width 3"], mask: Bool[np.ndarray, "height width"], width: int
) -> UInt8[np.ndarray, "height width 3"]:
    """The picture with the mask's outline drawn along its inside.

    Args:
        image: RGB.
        mask: of the same size.
        width: of the line, pixels.
    """
    inner = cv2.erode(mask.astype(np.uint8), np.ones((2 * width + 1, 2 * width + 1), np.uint8), borderValue=0)
    drawn = image.copy()
    drawn[mask & (inner == 0)] = OUTLINE
    return drawn


def _picture(row: Record, cell: int, settings: Settings, workspace: Workspace) -> Image.Image | None:
    """The crop, else the photograph; ``None`` where neither can be seen."""
    try:
        crop, small = workspace.crop(row.id, "rgb.jpg"), workspace.crop(row.id, "mask.png")
        if row.window is not None and crop.is_file() and small.is_file():
            image = np.array(Image.open(crop).convert("RGB"))
            mask = np.array(Image.open(small).convert("L")) > 127
        else:
            image = open_photograph(row, settings, workspace).image
            path = workspace.mask(row.id)
            mask = read_mask(path) if path.is_file() else np.zeros(image.shape[:2], bool)
    except (Refused, FaunaError, OSError, UnidentifiedImageError):
        return None
    line = max(round(max(image.shape) / cell), 1)
    picture = Image.fromarray(outlined(image, mask, line) if mask.shape == image.shape[:2] else image)
    picture.thumbnail((cell - 2, cell - 2))
    return picture


def _caption(row: Record, word: str) -> Iterator[str]:
    values = {
        "blurred": ("sharp", row.sharpness), "truncated": ("cut", row.truncation), "low_fill": ("fill", row.fill),
        "high_fill": ("fill", row.fill), "occluded": ("hidden", row.occlusion),
    }  # fmt: skip
    name, value = values.get(word, ("", None))
    yield row.id
    said = f"{name} {value:.3g}" if value is not None else ""
    kept = "KEPT" if row.ok and word != USED else ""
    yield " ".join(part for part in (row.species, said, kept) if part)
