"""From a photo on disk to a posed mesh, without rendering: time of every part, encoder included.

One row per grid resolution (the paper's units, in the field ``spacing``); medians in milliseconds, resolutions taking turns in one
process. Without ``--weights`` the model is an untrained one of ``+experiment=laptop`` with all parts switched on; ``--width`` sets
the SDF's hidden layers. ``rest`` is what lies between the parts.

    python benchmarks/inference.py [--smoke | --full] [--weights FILE] [--photo FILE] [--threads 2] [--json FILE]
"""

import argparse
import json
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch
from arguments import existing_file, new_file
from clock import Clock
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig
from PIL import Image
from torch import Tensor

from fauna._conf import CONF_DIR
from fauna.build import build_encoder, build_model, build_schedule
from fauna.data.photos import resize_image
from fauna.io.checkpoint import load_weights, read_weights
from fauna.model import FaunaModel
from fauna.threads import set_threads
from fauna.types import PosedMesh
from fauna.viewpoint.selection import best, camera_for

WARM_UP = 2
MASK_SIDE = 64
PARTS = (
    *(
        "decode",
        "encoder",
        "mask_embedding",
        "bank",
        "shape",
        "embedder",
        "viewpoint",
        "deformation",
        "skeleton",
        "articulation",
    ),
    *("skinning", "rest"),
)


def decode(path: Path, size: int) -> Tensor:
    """A square photo as the encoder's input, (1, 3, size, size)."""
    with Image.open(path) as picture:
        return resize_image(np.array(picture.convert("RGB")), size)[None]


@torch.no_grad()
def reconstruct(model: FaunaModel, images: Tensor, clock: Clock) -> PosedMesh:
    """The lines of ``FaunaModel.forward`` up to the posed mesh, with the most likely viewpoint."""
    masks = images.new_ones(1, MASK_SIDE, MASK_SIDE)  # what it shows changes no time
    features = model.feature_space.normalize(clock.timed("encoder", model.encoder)(images))
    features = clock.timed("mask_embedding", model.mask_embedding)(features, masks)
    readout = clock.timed("bank", model.bank)(features.global_, None)
    base = clock.timed("shape", model.shape)(readout.embedding.mean(dim=0), None)
    embedding = clock.timed("embedder", model.embedder)(features)
    stage = model.stage
    hypotheses = clock.timed("viewpoint", model.viewpoint)(
        features, temperature=stage.temperature, elevation=stage.elevation
    )
    selection = best(hypotheses)
    camera = camera_for(hypotheses, selection, fov_deg=model.camera["fov_deg"], distance=model.camera["distance"])
    instance = clock.timed("deformation", model.deform)(base, embedding)
    return model.articulate(base, instance, features, embedding, selection, camera, masks, masks)[2]


def instrument(model: FaunaModel, clock: Clock) -> None:
    """Time what ``FaunaModel.articulate`` is made of from inside."""
    for owner, name, part in (
        (model.rig, "rest", "skeleton"),
        (model.articulation, "forward", "articulation"),
        (model.rig, "pose", "skinning"),
    ):
        object.__setattr__(owner, name, clock.timed(part, getattr(owner, name)))  # a rig is a frozen dataclass


def make_model(args: argparse.Namespace) -> FaunaModel:
    """Trained, or untrained with random weights and statistics; articulation and deformation switched on."""
    torch.manual_seed(0)
    if args.weights is None:
        experiment = "tiny" if args.smoke else "laptop"
        width = [] if args.width is None else [f"shape.sdf.hidden_dim={args.width}"]
        with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
            cfg = compose("train", overrides=[f"+experiment={experiment}", *width, *args.overrides])
    else:
        cfg = DictConfig(read_weights(args.weights)[1]["config"])
    model = build_model(cfg, build_encoder(cfg))
    if args.weights is None:
        model.set_stage(build_schedule(cfg).at(cfg.trainer.max_steps))
        model.feature_space.load_state_dict(model.feature_space.state_dict() | {"fitted": torch.tensor(True)})
    else:
        load_weights(model, args.weights)
    model.set_stage(replace(model.stage, articulation=True, deformation=True))
    return model.eval()


def zoo_photo(folder: Path) -> Path:
    """A drawn horse as a JPEG file."""
    from fauna.zoo import Zoo

    path = folder / "horse.jpg"
    Image.fromarray(Zoo(seed=0, image_size=256).sample("horse", 0).image).save(path, quality=95)
    return path


def measure(model: FaunaModel, photo: Path, resolutions: Sequence[int], repeats: int) -> list[dict[str, Any]]:
    """One row per resolution."""
    clock = Clock()
    instrument(model, clock)
    times: dict[int, list[dict[str, float]]] = defaultdict(list)
    for repeat in range(WARM_UP + repeats):
        for resolution in resolutions:
            model.set_stage(replace(model.stage, grid_resolution=resolution))
            clock.parts.clear()
            start = time.perf_counter()
            images = clock.timed("decode", decode)(photo, model.encoder.input_size)
            mesh = reconstruct(model, images, clock)
            total = 1e3 * (time.perf_counter() - start)
            assert mesh.verts.isfinite().all()
            if repeat >= WARM_UP:
                times[resolution].append(clock.parts | {"rest": total - sum(clock.parts.values()), "total": total})
    return [
        {
            "spacing": resolution,
            "median_ms": round(median(each["total"] for each in runs), 2),
            "parts": {part: round(median(each.get(part, 0.0) for each in runs), 2) for part in PARTS},
        }
        for resolution, runs in times.items()
    ]


def main(argv: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Print and return one row per resolution."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--smoke", action="store_true", help="experiment tiny at resolution 32, two repeats")
    size.add_argument("--full", action="store_true", help="SDF layers of width 256 and four times the repeats")
    parser.add_argument("--weights", type=existing_file, help="a trained model instead of a random one")
    parser.add_argument("--photo", type=existing_file, help="square crop; default: a drawn horse")
    parser.add_argument("--width", type=int, help="of the SDF's hidden layers; default: the experiment's")
    parser.add_argument("--resolutions", type=int, nargs="+", default=[64, 128, 256])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--json", type=new_file, help="also write the rows to this file")
    parser.add_argument(
        "--overrides", nargs="*", default=[], help="further Hydra overrides, e.g. encoder.dtype=bfloat16"
    )
    args = parser.parse_args(argv)
    if args.smoke:
        args.resolutions, args.repeats, args.threads = [32], 2, 1
    if args.full:
        args.width, args.repeats = args.width or 256, 4 * args.repeats
    set_threads(args.threads)
    with tempfile.TemporaryDirectory() as folder:
        photo = args.photo or zoo_photo(Path(folder))
        rows = measure(make_model(args), photo, args.resolutions, args.repeats)
    for row in rows:
        print(f"resolution {row['spacing']:4d}  {row['median_ms']:9.1f} ms  photo to posed mesh")
        for part, value in row["parts"].items():
            print(f"    {part:14s} {value:9.2f} ms  {value / row['median_ms']:6.3f}")
    if args.json is not None:
        args.json.write_text(json.dumps(rows, indent=1) + "\n")
    return rows


if __name__ == "__main__":
    main()
