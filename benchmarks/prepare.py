"""What preparation costs: milliseconds and bytes of a photograph in every stage, and peak memory at two sizes of a set.

One row per stage and set, in the fields ``stage``, ``photographs``, ``ms_each``, ``bytes_each`` and ``peak_megabytes``. Photographs are drawn noise
of 500 x 375 pixels in JPEG with masks beside them; their content decides nothing but the segmenter's time. The stages that look at all
photographs at once are measured on rows without pictures. Every set is prepared by a process of its own, on one thread.

    python benchmarks/prepare.py [--smoke | --full] [--encoder NAME] [--json FILE]
"""

import argparse
import json
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from arguments import new_file
from PIL import Image

from fauna.prepare.duplicates import find_duplicates
from fauna.prepare.pipeline import Pipeline
from fauna.prepare.place import place, write_manifest
from fauna.prepare.record import Record, Rows, photo_id, row_id
from fauna.prepare.settings import Settings, prepare_settings
from fauna.prepare.split import Members, assigned, choose_split
from fauna.prepare.tables import read_columns, read_table, write_table
from fauna.prepare.workspace import Workspace
from fauna.threads import set_threads

FIELDS = ("stage", "photographs", "ms_each", "bytes_each", "peak_megabytes")
PER_PHOTO = ("scan", "mask", "crop", "filter", "features")
FOLDERS = {"mask": ("masks", ""), "crop": ("crops", ""), "features": ("crops", "feat16.png")}
DEFAULT, SMOKE, FULL = (64, 256), (2, 4), (256, 1024)
ROWS, SMOKE_ROWS, FULL_ROWS = (20_000, 100_000), (50, 100), (100_000, 1_000_000)
GRABCUT = 8
SIZE = (500, 375)


def draw(folder: Path, count: int, masks: bool) -> None:
    """Photographs of noise with an ellipse as their mask."""
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    mask = ((rows / SIZE[1] - 0.5) / 0.3) ** 2 + ((columns / SIZE[0] - 0.5) / 0.35) ** 2 < 1
    for number in range(count):
        path = folder / ("horse", "zebra")[number % 2] / f"{number:06d}.jpg"
        path.parent.mkdir(parents=True, exist_ok=True)
        coarse = np.random.default_rng(number).integers(0, 255, (24, 32, 3), dtype=np.uint8)
        Image.fromarray(coarse).resize(SIZE, Image.Resampling.BICUBIC).save(path, quality=90)
        if masks:
            Image.fromarray(mask).save(path.with_name(f"{path.stem}_mask.png"))


def stages(count: int, encoder: str | None, grabcut: bool) -> list[dict[str, Any]]:
    """Prepare ``count`` photographs; a row per stage."""
    set_threads(1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        draw(folder / "pile", count, masks=not grabcut)
        chosen = ["filter.min_sharpness=null", "filter.min_fill=null", f"features.encoder={encoder or 'null'}"]
        settings = prepare_settings(chosen)
        workspace = Workspace(folder / "pile", folder / "set", folder / "set.work")
        workspace.dest.mkdir()
        pipeline = Pipeline(settings, workspace)
        (shard,) = pipeline.shards()
        found = []
        for stage in PER_PHOTO[: 2 if grabcut else 4 if encoder is None else 5]:
            if stage == "features":
                pipeline.basis()
            tally = pipeline.run(stage, shard)
            bytes_each = _bytes(workspace, stage) / count
            named = "mask, grabcut" if grabcut and stage == "mask" else stage
            found.append(_row(named, count, tally.seconds, bytes_each))
        if grabcut:
            return found[1:]
        return found + _finish(pipeline, settings, workspace, count)


def _finish(pipeline: Pipeline, settings: Settings, workspace: Workspace, count: int) -> list[dict[str, Any]]:
    start = time.perf_counter()
    split = pipeline.split()
    place(lambda: pipeline.rows("split"), split.joint, workspace, lambda: None)
    seconds = time.perf_counter() - start
    size = sum(path.stat().st_size for path in workspace.dest.rglob("*") if path.is_file())
    found = [_row("split and place", count, seconds, size / count)]
    start = time.perf_counter()
    (manifest,) = write_manifest(pipeline.merged("split"), workspace, count, settings.manifest_rows)
    found.append(_row("manifest", count, time.perf_counter() - start, manifest.stat().st_size / count))
    kept = ("tables", "journals")
    size = sum(path.stat().st_size for name in kept for path in (workspace.work / name).rglob("*") if path.is_file())
    found.append(_row("tables and journals", count, 0.0, size / count))
    return found


def together(count: int, encoder: str | None, grabcut: bool) -> list[dict[str, Any]]:
    """The stages that see all photographs at once, on ``count`` rows without pictures."""
    settings = prepare_settings([])
    with tempfile.TemporaryDirectory() as name:
        table = Path(name) / "scan.parquet"
        start = time.perf_counter()
        write_table(table, (row for rows in listed(count) for row in rows))
        found = [_row("table, written", count, time.perf_counter() - start, table.stat().st_size / count)]
        start = time.perf_counter()
        for _ in read_table(table):
            pass
        found.append(_row("table, read", count, time.perf_counter() - start, 0.0))
        start = time.perf_counter()
        verdicts = find_duplicates(listed(count), settings.duplicates)
        found.append(_row("duplicates, found", count, time.perf_counter() - start, 0.0))
        del verdicts
        start = time.perf_counter()
        members = Members()
        for part in read_columns(table, ["species", "photo"]):
            for species, photo in zip(part["species"], part["photo"], strict=True):
                members.add(species, photo)
        split = choose_split(members, settings.split)
        found.append(_row("split, chosen", count, time.perf_counter() - start, 0.0))
        assert next(assigned(read_table(table), split, frozenset())).split
    return found


def listed(count: int) -> Iterator[Rows]:
    """Rows as a scan leaves them, of random pictures."""
    rng = np.random.default_rng(0)
    for number in range(count):
        source = f"species_{number % 128:03d}/{number:09d}.jpg"
        photo = photo_id("benchmark", source, None)
        yield (
            Record(
                id=row_id(photo, 0), photo=photo, instance=0, dataset="benchmark", source=source, species=source[:11], group=source,
                sha256=rng.bytes(32).hex(), phash=rng.bytes(8).hex(), format="JPEG", width=500, height=375, orientation=1,
            ),
        )  # fmt: skip


def _bytes(workspace: Workspace, stage: str) -> int:
    folder, end = FOLDERS.get(stage, ("", ""))
    if not folder:
        return 0
    return sum(path.stat().st_size for path in (workspace.work / folder).rglob(f"*{end}") if path.is_file())


def _row(stage: str, count: int, seconds: float, bytes_each: float) -> dict[str, Any]:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    values = (stage, count, round(1e3 * seconds / count, 4), round(bytes_each, 1), round(peak, 1))
    return dict(zip(FIELDS, values, strict=True))


def alone(function: Callable[..., list[dict[str, Any]]], *given: Any) -> list[dict[str, Any]]:
    """The rows of a function that runs in a process of its own, so that its peak memory is its own."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(function, given)


def main(arguments: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--smoke", action="store_true", help="a few photographs, for the test")
    size.add_argument("--full", action="store_true", help="more of everything")
    parser.add_argument(
        "--encoder", default="efficientnet_lite0", help="of the feature maps, or null (default: %(default)s)"
    )
    parser.add_argument("--json", type=new_file, metavar="FILE")
    given = parser.parse_args(arguments)
    encoder = None if given.encoder == "null" else given.encoder
    photos, rows = (SMOKE, SMOKE_ROWS) if given.smoke else (FULL, FULL_ROWS) if given.full else (DEFAULT, ROWS)
    found = []
    for count in photos:
        found += alone(stages, count, encoder, False)
    found += alone(stages, 1 if given.smoke else GRABCUT, None, True)
    for count in rows:
        found += alone(together, count, None, False)
    print(f"{'stage':<22}{'photographs':>12}{'ms each':>10}{'bytes each':>12}{'peak MB':>9}")
    for row in found:
        print(
            f"{row['stage']:<22}{row['photographs']:>12,}{row['ms_each']:>10.3f}{row['bytes_each']:>12,.0f}{row['peak_megabytes']:>9,.0f}"
        )
    if given.json is not None:
        given.json.write_text(json.dumps(found, indent=1) + "\n")
    return found


if __name__ == "__main__":
    main()
