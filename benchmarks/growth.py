"""Cost against size: how time and memory grow along one axis at a time, the others at the laptop's values.

One row per (axis, value, part): ``median_ms`` of forward plus backward, ``memory_mb`` at the peak above what was held
before (Linux; of list parts: what they hold), and ``exponent``, the slope of log(ms) over log(value) from the previous
value. What to expect, and why:

===========  =================================================================================================
axis         growth
===========  =================================================================================================
image_size   render: a constant (vertices, edges, topology), then covered pixels: 2. Above 2 at 512: activations
             of hundreds of MB are returned to the system after every step, and their pages are made anew
             (half the time; gone with MALLOC_MMAP_MAX_=0 and a huge MALLOC_TRIM_THRESHOLD_)
batch        render, articulation, skinning, step: 1 behind a constant; base shape and bank: 0, shared by photos
spacing      (resolution of the grid) a surface crosses n^2 of n^3 cells: 2, where dense extraction has 3;
             skeleton, skinning and render have n^2 vertices: 2; the step inherits it
slots        bank: 0 while calls dominate, then 1, as every key is compared and has a gradient; step: 0
rows         draw: shuffles one species, so 1 in the photos of a species with 5 ns each; its memory is a list of
             indices, 38 bytes a row. Listing and splitting photos: 1
threads      two threads help large tensors only; below 0 is a gain. Meaningless on a machine that is not idle
steps        resident memory at the end of a short training against after its warm-up: constant
===========  =================================================================================================

    python benchmarks/growth.py [--smoke | --full] [--axes image_size batch ...] [--json FILE]
"""

import argparse
import ctypes
import gc
import json
import math
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import torch
from arguments import new_file
from growth_scenes import Parts, Scene, compose_experiment, listed

from fauna.data.species_sampler import SpeciesSampler
from fauna.data.splits import SplitSize, complete_splits
from fauna.system import FaunaSystem
from fauna.threads import set_threads

Row = dict[str, Any]
SPECIES = 128  # of the simulated dataset, as in the paper
WARM_UP = 2

VALUES: dict[str, dict[str, tuple[int, ...]]] = {
    "image_size": {"smoke": (32, 64), "default": (64, 128, 256, 512), "full": (64, 128, 256, 512)},
    "batch": {"smoke": (1, 2), "default": (1, 2, 4, 8, 16, 32), "full": (1, 2, 4, 8, 16, 32)},
    "spacing": {"smoke": (24, 32), "default": (32, 64, 128, 256), "full": (32, 64, 128, 256)},
    "slots": {"smoke": (10, 60), "default": (10, 60, 100, 1000, 10_000), "full": (10, 60, 100, 1000, 10_000)},
    "rows": {"smoke": (1000, 2000), "default": (10**3, 10**4, 10**5, 10**6, 10**7), "full": (10**3, 10**5, 10**7)},
    "threads": {"smoke": (1,), "default": (1, 2), "full": (1, 2)},
    "steps": {"smoke": (6,), "default": (300,), "full": (3000,)},
}


def scene_of(experiment: str, axis: str, value: int) -> Parts:
    """The parts an axis touches, with its value set."""
    if axis == "image_size":
        return Scene(experiment, size=value).parts(("render", "step"))
    if axis == "batch":
        return Scene(experiment, photos=value).parts(("bank", "shape", "articulation", "skinning", "render", "step"))
    if axis == "spacing":
        return Scene(experiment, f"shape.grid_resolution={value}").parts(
            ("shape", "skeleton", "skinning", "render", "step")
        )
    if axis == "slots":
        return Scene(experiment, f"bank.num_slots={value}").parts(("bank", "step"))
    return Scene(experiment).parts(("shape", "skeleton", "articulation", "skinning", "render", "step"))  # threads


def index_parts(rows: int) -> tuple[Parts, dict[str, float | None]]:
    """A dataset index of so many photos without files; what listing and drawing hold, MB."""
    species = min(SPECIES, rows // 8)
    start = resident_mb()
    sampler = SpeciesSampler(
        photos_per_category=[rows // species] * species,
        back_views_per_category=[0] * species,
        batch_size=6,
        micro_batches=1,
        flip_probability=0.5,
        seed=0,
    )
    held = {"draw": None if start is None else resident_mb() - start}  # type: ignore[operator]
    steps = iter(range(10**9))
    parts: Parts = {"draw": lambda: sampler.batch(next(steps))}
    if rows > 10**5:
        return parts, held
    start = resident_mb()
    pools = {name: listed(name, rows // species) for name in map("species {:03d}".format, range(species))}
    held["split"] = None if start is None else resident_mb() - start  # type: ignore[operator]
    size = SplitSize(0.12, 12)
    parts["split"] = lambda: complete_splits(pools, path=None, seed=0, val=size, test=size, held_out=[])
    return parts, held


def status_mb(field: str) -> float | None:
    """A size from the kernel's account of this process; ``None`` outside of Linux."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return None
    return next(int(line.split()[1]) for line in lines if line.startswith(field + ":")) / 1024


def resident_mb() -> float | None:
    """Resident memory after unused memory went back to the system."""
    gc.collect()
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # glibc only
        if trim is not None:
            trim(0)
    return status_mb("VmRSS")


def peak_mb(function: Callable[[], Any]) -> float | None:
    """How far one call raises the resident memory above what is held before."""
    before = resident_mb()
    if before is None:
        return None
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts again from the current size
    function()
    peak = status_mb("VmHWM")
    return None if peak is None else max(peak - before, 0.0)


def timed_ms(function: Callable[[], Any]) -> float:
    """Milliseconds of one call."""
    start = time.perf_counter()
    function()
    return 1e3 * (time.perf_counter() - start)


def measure_axis(experiment: str, axis: str, values: Sequence[int], repeats: int) -> list[Row]:
    """Rows of an axis."""
    held: dict[int, dict[str, float | None]] = {}
    scenes: dict[int, Parts] = {}
    for value in values:
        if axis == "rows":
            scenes[value], held[value] = index_parts(value)
        else:
            scenes[value] = scene_of(experiment, axis, value)
    times = time_in_turns(scenes, repeats, threads=axis == "threads")
    rows = []
    for value, parts in scenes.items():
        for part, function in parts.items():
            memory = held[value][part] if axis == "rows" else peak_mb(function)
            rows.append(new_row(axis, value, part, median(times[value, part]), memory))
    return with_exponents(rows)


def time_in_turns(scenes: dict[int, Parts], repeats: int, *, threads: bool) -> dict[tuple[int, str], list[float]]:
    """Milliseconds of every part of every scene; scenes take turns, except that idle threads would disturb others."""
    times: dict[tuple[int, str], list[float]] = defaultdict(list)
    for group in [[value] for value in scenes] if threads else [list(scenes)]:
        set_threads(group[0] if threads else 1)
        for repeat in range(WARM_UP + repeats):
            for value, part in [(each, part) for each in group for part in scenes[each]]:
                elapsed = timed_ms(scenes[value][part])
                if repeat >= WARM_UP:
                    times[value, part].append(elapsed)
    set_threads(1)
    return times


def measure_steps(steps: int) -> Row:
    """Resident memory of a short training with everything around it, at the end against after the warm-up."""
    from fauna.train import train

    warm_up = max(steps // 5, min(60, steps - 1))
    sizes: list[float] = []
    times: list[float] = []
    original = FaunaSystem.training_step

    def recorded(system: FaunaSystem, batch: Any, batch_idx: int) -> None:
        times.append(timed_ms(lambda: original(system, batch, batch_idx)))
        if len(times) in (warm_up, steps):
            sizes.append(resident_mb() or math.nan)

    quiet = ("callbacks.preview=null", "callbacks.progress=null", f"trainer.max_steps={steps}")
    cfg = compose_experiment("tiny", *quiet, f"trainer.val_every={steps + 1}")
    with tempfile.TemporaryDirectory() as folder, patch.object(FaunaSystem, "training_step", recorded):
        train(cfg, Path(folder) / "run")
    growth = sizes[1] - sizes[0]
    return new_row("steps", steps, "growth_mb", median(times[warm_up:]), None if math.isnan(growth) else growth)


def new_row(axis: str, value: int, part: str, ms: float, memory: float | None) -> Row:
    """A row without its exponent."""
    rounded = None if memory is None else round(memory, 2)
    found = {"axis": axis, "value": value, "part": part, "median_ms": round(ms, 4), "memory_mb": rounded}
    return {**found, "exponent": None}


def with_exponents(rows: list[Row]) -> list[Row]:
    """The same rows with the slope of log(ms) over log(value) between neighbours of a part."""
    last: dict[str, Row] = {}
    result = []
    for each in rows:
        before = last.get(each["part"])
        if before is not None and before["median_ms"] > 0:
            slope = math.log(each["median_ms"] / before["median_ms"]) / math.log(each["value"] / before["value"])
            each = {**each, "exponent": round(slope, 2)}
        last[each["part"]] = each
        result.append(each)
    return result


def main(argv: Sequence[str] | None = None) -> list[Row]:
    """Print and return the rows of all axes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--smoke", action="store_true", help="two small values of every axis, one repeat")
    size.add_argument("--full", action="store_true", help="more repeats, 3000 steps")
    parser.add_argument("--axes", nargs="+", choices=list(VALUES), default=list(VALUES))
    parser.add_argument("--repeats", type=int, help="timed runs of every part")
    parser.add_argument("--json", type=new_file, help="also write the rows to this file")
    args = parser.parse_args(argv)
    extent = "smoke" if args.smoke else "full" if args.full else "default"
    experiment = "tiny" if args.smoke else "laptop"
    repeats = args.repeats or {"smoke": 1, "default": 7, "full": 21}[extent]
    torch.use_deterministic_algorithms(True)
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]
    set_threads(1)
    rows: list[Row] = []
    for axis in args.axes:
        values = VALUES[axis][extent]
        found = [measure_steps(values[0])] if axis == "steps" else measure_axis(experiment, axis, values, repeats)
        for each in sorted(found, key=lambda each: each["part"]):
            memory, slope = (("-" if each[key] is None else f"{each[key]:.2f}") for key in ("memory_mb", "exponent"))
            print(
                f"{axis:10s} {each['value']:9d} {each['part']:13s} {each['median_ms']:11.3f} ms {memory:>9s} MB {slope:>6s}"
            )
        rows += found
    if args.json is not None:
        args.json.write_text(json.dumps(rows, indent=1) + "\n")
    return rows


if __name__ == "__main__":
    main()
