"""Time of one training step and of its parts, in every stage of the schedule, beside the naive structure of the same step.

The step is the one of ``fauna.system.FaunaSystem`` without Lightning around it: batch, forward pass, losses, backward pass,
Adam, and the discriminator's own step; one micro-batch, features from the cache. Parts are timed inside the same steps;
``losses`` is what remains of the forward pass. The naive step (``benchmarks/naive.py``) takes turns with ours in the same
process. Medians in milliseconds; ``ratio`` is naive over ours. The first steps of each stage are not counted.

Cases: ``laptop`` at 64 and 128 pixels and ``quadruped``, the paper's sizes with the offline encoder in place of DINO. The naive
step of ``quadruped`` takes more than a minute and 16 GB: once in one stage, if that much memory is free.

    python benchmarks/step.py [--smoke | --full] [--cases laptop-64,...] [--weights FILE] [--json FILE] [override ...]
"""

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import numba
import torch
from arguments import existing_file, new_file
from clock import Clock
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from naive import naive_structure
from omegaconf import DictConfig

import fauna.model
from fauna._conf import CONF_DIR
from fauna.build import build_encoder, build_model, build_schedule, build_system
from fauna.data.species_sampler import SpeciesSampler
from fauna.io.checkpoint import load_weights
from fauna.random import Draws
from fauna.stages import Schedule
from fauna.system import FaunaSystem
from fauna.types import Batch

WARM_UP = 2
PARTS = (
    *(
        "data",
        "features",
        "bank",
        "shape",
        "embedder, viewpoint",
        "deformation",
        "skeleton",
        "articulation",
        "skinning",
    ),
    *("render", "eikonal", "adversarial", "losses", "backward", "optimizer", "discriminator"),
)
FORWARD = PARTS[1:12]


class Runner:
    """A system that can do single steps.

    Args:
        cfg: composed configuration.
        clock: receives the times of the parts.
        threads: of torch and numba.
        weights: start from these instead of from random ones.
    """

    def __init__(self, cfg: DictConfig, clock: Clock, threads: int, weights: Path | None) -> None:
        torch.manual_seed(cfg.seed)
        self.clock = clock
        self.threads = threads
        encoder = build_encoder(cfg)
        self.data = instantiate(cfg.data, _convert_="all", _partial_=True)(encoder=encoder)
        self.data.prepare(seed=cfg.seed, report=lambda line: None)
        self.system: FaunaSystem = build_system(cfg, build_model(cfg, encoder))
        if weights is None:
            self.system.model.feature_space.fit(self.data.feature_samples())
        else:
            load_weights(self.system.model, weights)
        self.optimizer, self.discriminator = self.system.configure_optimizers()
        pools = [self.data.by_category[name] for name in self.data.train_species]
        self.sampler = SpeciesSampler(
            photos_per_category=[len(pool.train) for pool in pools],
            back_views_per_category=[len(pool.back_views) for pool in pools],
            batch_size=self.data.batch_size,
            micro_batches=1,
            flip_probability=self.data.flip_probability,
            seed=cfg.seed,
        )

    def step(self, schedule: Schedule, step: int, repeat: int) -> dict[str, float]:
        """One step in the stage of ``step`` with the batch and draws of ``repeat``; milliseconds per part."""
        torch.set_num_threads(self.threads)
        numba.set_num_threads(min(self.threads, numba.config.NUMBA_NUM_THREADS))
        self.system.set_stage(schedule.at(step))
        self.system.adversarial = self.system.model.stage.adversarial
        self.clock.parts.clear()
        start = time.perf_counter()
        (batch,) = self.clock.timed("data", self.data.step_batches)(repeat, self.sampler, 0)
        self._generator(batch, Draws(0, repeat))
        parts = dict(self.clock.parts)
        parts["losses"] = parts.pop("forward") - sum(parts.get(name, 0.0) for name in FORWARD)
        return {**parts, "step": 1e3 * (time.perf_counter() - start)}

    def _generator(self, batch: Batch, draws: Draws) -> None:
        timed = self.clock.timed
        self.optimizer.zero_grad()
        losses, _, pair = timed("forward", self.system.generator_losses)(batch, draws)
        timed("backward", losses.total.backward)()
        timed("optimizer", self._update)()
        if pair is not None:
            timed("discriminator", self._discriminate)(pair)

    def _update(self) -> None:
        if self.system.options.clip_norm is not None:
            torch.nn.utils.clip_grad_norm_(self.system.model.parameters(), self.system.options.clip_norm)
        self.optimizer.step()

    def _discriminate(self, pair: Any) -> None:
        self.discriminator.zero_grad()
        self.system.adversary.discriminator_loss(pair)["discriminator"].backward()
        self.discriminator.step()


def instrument(system: FaunaSystem, clock: Clock) -> None:
    """Time the parts of the forward pass from inside, without changing what they do."""
    model = system.model
    methods = [
        (model, "encode", "features"),
        (model.feature_space, "normalize", "features"),
        (model.bank, "forward", "bank"),
        (model.shape, "forward", "shape"),
        (model.embedder, "forward", "embedder, viewpoint"),
        (model.viewpoint, "forward", "embedder, viewpoint"),
        (model, "deform", "deformation"),
        (model.rig, "rest", "skeleton"),
        (model.articulation, "forward", "articulation"),
        (model.rig, "pose", "skinning"),
        (model.shape, "eikonal", "eikonal"),
        (system.adversary, "generator_loss", "adversarial"),
    ]
    for owner, name, part in methods:
        object.__setattr__(owner, name, clock.timed(part, getattr(owner, name)))  # a rig is a frozen dataclass


def stages_of(schedule: Schedule) -> dict[str, int]:
    """A step inside each stage that the schedule reaches; of two equal ones the later name is kept."""
    windows = schedule.windows
    starts = {name: window[0] for name, window in windows.items() if window is not None}
    found: dict[str, int] = {}
    if "articulation" in starts:
        found["before articulation"] = max(starts["articulation"] - 1, 0)
        following = min((start for start in starts.values() if start > starts["articulation"]), default=None)
        found["articulated"] = starts["articulation"] if following is None else following - 1
    if "adversarial" in starts:
        found["adversarial"] = (windows["adversarial"][1] or starts["adversarial"] + 1) - 1
    if "deformation" in starts:
        found["deformed"] = starts["deformation"]
    return {name: step - schedule.start_at for name, step in found.items() if step >= schedule.start_at}


@dataclass(frozen=True)
class Case:
    """What to time: an experiment at an image size, with the number of threads.

    Attributes:
        experiment: name of the configuration.
        overrides: further Hydra overrides.
        threads: of torch and numba.
        repeats: of our step in every stage.
        naive_repeats: of the naive step.
        naive_stages: stages in which the naive step is timed, ``None`` = all.
        naive_gigabytes: free memory the naive step needs.
    """

    experiment: str
    overrides: tuple[str, ...]
    threads: int
    repeats: int
    naive_repeats: int
    naive_stages: tuple[str, ...] | None
    naive_gigabytes: float


def cases_of(args: argparse.Namespace) -> dict[str, Case]:
    """The cases by name."""
    more = 4 if args.full else 1
    if args.smoke:
        return {"tiny": Case("tiny", (), 1, 2, 1, None, 0)}
    quadruped = ("encoder=efficientnet_lite0",)
    return {
        "laptop-64": Case("laptop", (), 2, 12 * more, 3 * more, None, 2),
        "laptop-64-one-thread": Case("laptop", (), 1, 12 * more, 3 * more, None, 2),
        "laptop-128": Case("laptop", ("data.image_size=128",), 2, 8 * more, 2 * more, None, 3),
        "quadruped": Case("quadruped", quadruped, 2, 3 * more, 1, ("articulated",), 19),
    }


def measure(case: Case, weights: Path | None, overrides: Sequence[str], photos: int) -> Iterator[dict[str, Any]]:
    """One row per stage."""
    clock = Clock()
    with patch.object(fauna.model, "render", clock.timed("render", fauna.model.render)):
        cfg = compose_experiment(case.experiment, [*case.overrides, *overrides], photos)
        runner = Runner(cfg, clock, case.threads, weights)
        instrument(runner.system, clock)
        schedule = build_schedule(cfg)
        for stage, step in stages_of(schedule).items():
            for repeat in range(WARM_UP):
                runner.step(schedule, step, repeat)
            ours: list[dict[str, float]] = []
            naive: list[float] = []
            wanted = case.naive_stages is None or stage in case.naive_stages
            turns = case.naive_repeats if wanted and free_gigabytes() > case.naive_gigabytes else 0
            for repeat in range(case.repeats):
                ours.append(runner.step(schedule, step, WARM_UP + repeat))
                if repeat < turns:
                    with naive_structure(runner.system):
                        naive.append(runner.step(schedule, step, WARM_UP + repeat)["step"])
            median_ms = median(parts["step"] for parts in ours)
            naive_ms = median(naive) if naive else None
            yield {
                "experiment": case.experiment,
                "image_size": cfg.data.image_size,
                "threads": case.threads,
                "stage": stage,
                "median_ms": round(median_ms, 1),
                "naive_ms": None if naive_ms is None else round(naive_ms, 1),
                "ratio": None if naive_ms is None else round(naive_ms / median_ms, 2),
                "parts": {part: round(median(parts[part] for parts in ours), 2) for part in PARTS if part in ours[0]},
            }


def free_gigabytes() -> float:
    """Memory that can be had without swapping; unlimited where the system does not say."""
    file = Path("/proc/meminfo")
    if not file.is_file():
        return float("inf")
    line = next(line for line in file.read_text().splitlines() if line.startswith("MemAvailable"))
    return int(line.split()[1]) / 2**20


def compose_experiment(experiment: str, overrides: Sequence[str], photos: int) -> DictConfig:
    """The experiment on a handful of zoo photos."""
    data = [] if experiment == "tiny" else ["data=zoo", "data.held_out=[]", f"data.source.photos_per_species={photos}"]
    data += [] if experiment == "tiny" else ["data.source.species=[horse,dog]", "data.cache_features=true"]
    data += ["data.image_size=256"] if experiment == "quadruped" else []
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return compose("train", overrides=[f"+experiment={experiment}", *data, *overrides])


def main(argv: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Print and return the rows of all cases."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--smoke", action="store_true", help="experiment tiny, two repeats")
    size.add_argument("--full", action="store_true", help="four times the repeats")
    parser.add_argument(
        "--cases", help="only these, separated by commas: laptop-64, laptop-64-one-thread, laptop-128, quadruped"
    )
    parser.add_argument(
        "--weights", type=existing_file, help="time a trained model: its mesh is larger than the first ellipsoid"
    )
    parser.add_argument("--json", type=new_file, help="also write the rows to this file")
    parser.add_argument("overrides", nargs="*", help="further Hydra overrides, e.g. bank=none")
    args = parser.parse_args(argv)
    torch.use_deterministic_algorithms(True)
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]
    cases = cases_of(args)
    names = args.cases.split(",") if args.cases else list(cases)
    if unknown := [name for name in names if name not in cases]:
        parser.error(f"--cases: expected names among {', '.join(cases)}, got {', '.join(unknown)}")
    rows: list[dict[str, Any]] = []
    for name in names:
        for row in measure(cases[name], args.weights, args.overrides, 6):
            rows.append(row)
            print_row(row)
    if args.json is not None:
        args.json.write_text(json.dumps(rows, indent=1) + "\n")
    return rows


def print_row(row: dict[str, Any]) -> None:
    """One line for the step and one for its parts."""
    naive = "" if row["naive_ms"] is None else f"   naive {row['naive_ms']:9.1f} ms   ratio {row['ratio']:6.2f}"
    head = f"{row['experiment']} {row['image_size']} px, {row['threads']} threads, {row['stage']}"
    print(f"{head:52s} {row['median_ms']:8.1f} ms{naive}")
    print("    " + ", ".join(f"{part} {ms:.1f}" for part, ms in row["parts"].items()), flush=True)


if __name__ == "__main__":
    main()
