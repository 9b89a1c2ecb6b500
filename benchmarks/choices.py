"""What the choices that save time cost in exactness: losses, gradients and mesh of the same steps under each of them.

Reference: float32 everywhere, the feature field at every compared pixel, every compared pixel shaded. ``loss_error`` is the
relative difference of the total loss; ``gradient_error`` the relative L2 distance, ``gradient_cosine`` the cosine between the
gradients of all parameters; ``bias`` the relative L2 distance of the mean gradient over all batches, in which noise of zero
mean averages out; ``vertex_error`` the mean and ``vertex_error_max`` the largest distance between corresponding vertices of the posed
meshes, world units.
Means over the batches; the mesh is that of ``--weights`` or untrained.

    python benchmarks/choices.py [--smoke | --full] [--experiment laptop] [--weights FILE] [--threads 2] [--json FILE]
"""

import argparse
import json
from collections.abc import Sequence
from statistics import mean, median
from typing import Any

import torch
from arguments import existing_file, new_file
from clock import Clock
from step import Runner, compose_experiment, stages_of
from torch import Tensor

from fauna.build import build_schedule
from fauna.networks import CoordMLP
from fauna.precision import Precision
from fauna.random import Draws
from fauna.system import FaunaSystem

REFERENCE = ("float32", "pixels", 1.0)
CHOICES: dict[str, tuple[Precision, str, float]] = {
    "feature_lookup=vertices": ("float32", "vertices", 1.0),
    "field_precision=bfloat16": ("bfloat16", "pixels", 1.0),
    "shade_fraction=0.5": ("float32", "pixels", 0.5),
    "shade_fraction=0.25": ("float32", "pixels", 0.25),
    "all three": ("bfloat16", "vertices", 0.25),
}


def choose(system: FaunaSystem, precision: Precision, lookup: str, fraction: float) -> None:
    """Set a choice on a built system."""
    for module in system.modules():
        if isinstance(module, CoordMLP):
            module.precision = precision
    system.model.feature_lookup = lookup  # type: ignore[assignment]
    system.model.shade_fraction = fraction


def gradients(runner: Runner, repeat: int) -> tuple[float, Tensor, Tensor]:
    """Total loss, flat gradient and posed vertices of one step."""
    system = runner.system
    system.zero_grad()
    (batch,) = runner.data.step_batches(repeat, runner.sampler, 0)
    losses, out, _ = system.generator_losses(batch, Draws(0, repeat))
    losses.total.backward()
    flat = [p.grad.flatten() if p.grad is not None else p.new_zeros(p.numel()) for p in system.model.parameters()]
    return float(losses.total.detach()), torch.cat(flat), out.posed.verts.detach()


def compare(runner: Runner, schedule: Any, stage: str, step: int, batches: int) -> list[dict[str, Any]]:
    """Rows of one stage."""
    settings = {"reference": REFERENCE, **CHOICES}
    times: dict[str, list[float]] = {name: [] for name in settings}
    found: dict[str, list[tuple[float, Tensor, Tensor]]] = {name: [] for name in settings}
    weights = {name: value.clone() for name, value in runner.system.state_dict().items() if isinstance(value, Tensor)}
    for repeat in range(batches):
        for name, setting in settings.items():
            choose(runner.system, *setting)
            times[name].append(runner.step(schedule, step, repeat)["step"])
            runner.system.load_state_dict(weights, strict=False)
            found[name].append(gradients(runner, repeat))
    return [row(stage, name, times, found) for name in CHOICES]


def row(stage: str, name: str, times: dict[str, list[float]], found: dict[str, list[Any]]) -> dict[str, Any]:
    """One choice against the reference."""
    pairs = list(zip(found[name], found["reference"], strict=True))
    average, expected = (torch.stack([each[1] for each in found[which]]).mean(0) for which in (name, "reference"))
    return {
        "stage": stage,
        "choice": name,
        "median_ms": round(median(times[name]), 1),
        "ratio": round(median(times["reference"]) / median(times[name]), 2),
        "loss_error": mean(abs(ours[0] - exact[0]) / abs(exact[0]) for ours, exact in pairs),
        "gradient_error": mean(float((ours[1] - exact[1]).norm() / exact[1].norm()) for ours, exact in pairs),
        "gradient_cosine": mean(
            float(torch.nn.functional.cosine_similarity(ours[1], exact[1], dim=0)) for ours, exact in pairs
        ),
        "bias": float((average - expected).norm() / expected.norm()),
        "vertex_error": mean(float((ours[2] - exact[2]).norm(dim=-1).mean()) for ours, exact in pairs),
        "vertex_error_max": max(float((ours[2] - exact[2]).norm(dim=-1).max()) for ours, exact in pairs),
    }


def main(argv: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Print and return the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--smoke", action="store_true", help="experiment tiny, two batches")
    size.add_argument("--full", action="store_true", help="four times the batches")
    parser.add_argument("--experiment", default="laptop")
    parser.add_argument("--weights", type=existing_file, help="of a trained model of the same configuration")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--json", type=new_file, help="also write the rows to this file")
    parser.add_argument("overrides", nargs="*", help="further Hydra overrides")
    args = parser.parse_args(argv)
    torch.use_deterministic_algorithms(True)
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]
    experiment, batches = ("tiny", 2) if args.smoke else (args.experiment, 32 if args.full else 8)
    cfg = compose_experiment(experiment, args.overrides, 6)
    runner, schedule = Runner(cfg, Clock(), args.threads, args.weights), build_schedule(cfg)
    rows: list[dict[str, Any]] = []
    for stage in ("articulated", "deformed"):
        for line in compare(runner, schedule, stage, stages_of(schedule)[stage], batches):
            rows.append(line)
            print(
                "  ".join(f"{k} {v:.3g}" if isinstance(v, float) else f"{v:26s}" for k, v in line.items()), flush=True
            )
    if args.json is not None:
        args.json.write_text(json.dumps(rows, indent=1) + "\n")
    return rows


if __name__ == "__main__":
    main()
