"""Time of one training step and of its parts, in every stage of the schedule.

The step is the one of ``fauna.system.FaunaSystem`` without Lightning around it: batch, forward pass, losses, backward pass, Adam,
and the discriminator's own step. Parts are timed inside the same steps; ``losses`` is what remains of the forward pass.
Variants (another renderer, twice the threads) run in the same process, those of equal threads taking turns. Medians in milliseconds; ``ratio`` is
relative to the base's whole step of the same stage. The first steps of each stage are not counted.

    python benchmarks/step.py [--smoke | --full] [--experiment laptop] [--weights FILE] [--json FILE]
"""

import argparse
import json
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import numba
import torch
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
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


@dataclass
class Clock:
    """Adds up the milliseconds of each part of the step under way."""

    parts: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    def timed(self, part: str, function: Callable) -> Callable:
        """The same function, with its time added to a part."""

        def wrapper(*args: Any, **kwargs: Any) -> Any:
            start = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                self.parts[part] += 1e3 * (time.perf_counter() - start)

        return wrapper


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


def measure(
    runners: dict[str, Runner], schedule: Schedule, stage: str, step: int, repeats: int
) -> list[dict[str, Any]]:
    """Rows of one stage; the first runner is the base."""
    times: dict[str, list[dict[str, float]]] = defaultdict(list)
    for threads in sorted(
        {runner.threads for runner in runners.values()}
    ):  # idle threads of a wider pool would disturb
        turns = {name: runner for name, runner in runners.items() if runner.threads == threads}
        for repeat in range(WARM_UP + repeats):
            for name, runner in turns.items():
                parts = runner.step(schedule, step, repeat)
                if repeat >= WARM_UP:
                    times[name].append(parts)
    base, *variants = runners
    whole = median(parts["step"] for parts in times[base])
    rows = [("step", whole)]
    rows += [(part, median(parts[part] for parts in times[base])) for part in PARTS if part in times[base][0]]
    rows += [(f"step, {name}", median(parts["step"] for parts in times[name])) for name in variants]
    return [
        {"stage": stage, "part": part, "ms": round(value, 2), "ratio": round(value / whole, 3)} for part, value in rows
    ]


def compose_experiment(experiment: str, overrides: Sequence[str], species: int, photos: int) -> DictConfig:
    """The experiment on a handful of zoo photos."""
    data = [] if experiment == "tiny" else ["data=zoo", "data.held_out=[]", f"data.source.photos_per_species={photos}"]
    data += [] if experiment == "tiny" else [f"data.source.species=[{','.join(('horse', 'dog', 'cow')[:species])}]"]
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return compose("train", overrides=[f"+experiment={experiment}", *data, *overrides])


def make_runners(args: argparse.Namespace, clock: Clock) -> tuple[dict[str, Runner], Schedule]:
    """The base and its variants."""
    photos = 12 if args.full else 6
    choices: dict[str, tuple[list[str], int]] = {"base": ([], args.threads)}
    if not args.base_only:
        choices["renderer=torch"] = (["renderer=torch"], args.threads)
        choices[f"{2 * args.threads} threads"] = ([], 2 * args.threads)
    runners = {}
    for name, (overrides, threads) in choices.items():
        cfg = compose_experiment(args.experiment, [*args.overrides, *overrides], 3 if args.full else 2, photos)
        runners[name] = Runner(cfg, clock, threads, args.weights)
        instrument(runners[name].system, clock)
    return runners, build_schedule(cfg)


def main(argv: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Print and return the rows of all stages."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--smoke", action="store_true", help="experiment tiny, two repeats")
    size.add_argument("--full", action="store_true", help="more photos and four times the repeats")
    parser.add_argument("--experiment", default="laptop")
    parser.add_argument(
        "--weights", type=Path, help="time a trained model: its mesh is larger than the first ellipsoid"
    )
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=12)
    parser.add_argument("--base-only", action="store_true", help="without variants")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    parser.add_argument("overrides", nargs="*", help="further Hydra overrides, e.g. bank=none")
    args = parser.parse_args(argv)
    if args.smoke:
        args.experiment, args.repeats = "tiny", 2
    torch.use_deterministic_algorithms(True)
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]
    clock = Clock()
    with patch.object(fauna.model, "render", clock.timed("render", fauna.model.render)):
        runners, schedule = make_runners(args, clock)
        rows: list[dict[str, Any]] = []
        for stage, step in stages_of(schedule).items():
            measured = measure(runners, schedule, stage, step, args.repeats * (4 if args.full else 1))
            for row in measured:
                print(f"{row['stage']:20s} {row['part']:24s} {row['ms']:9.2f} ms {row['ratio']:7.3f}", flush=True)
            rows += measured
    if args.json is not None:
        args.json.write_text(json.dumps(rows, indent=1) + "\n")
    return rows


if __name__ == "__main__":
    main()
