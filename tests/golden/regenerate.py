"""Writes ``tiny.json``: losses of ``+experiment=tiny`` on the drawn dataset of ``tests/runs.py``.

``curve`` holds the first steps of a training; later ones differ between processors, because training amplifies the last
bit. ``stages`` holds one step in every stage, each from the same untrained weights.

Run it from the checkout, with one thread, after a change that is meant to change the numbers::

    FAUNA_CACHE=$(mktemp -d) OMP_NUM_THREADS=1 PYTHONPATH=src:. python tests/golden/regenerate.py
"""

import json
from pathlib import Path

import torch

from fauna.build import build_encoder, build_model, build_system
from fauna.random import Draws
from fauna.threads import set_threads
from tests.runs import composed, logged, reference_run, tiny

CURVE = 8
STAGES = (0, 5, 9, 12, 17, 20, 22, 27)
"""Steps on both sides of every switch of the schedule ``tiny``."""


def stage_losses() -> dict[str, dict[str, float]]:
    """Terms of both players and the model's gradient norm, of one step in every stage."""
    from tests.test_system import batch, folder, open_window, photo_loader

    cfg = composed(*tiny())
    torch.manual_seed(0)
    encoder = build_encoder(cfg)
    system = build_system(cfg, build_model(cfg, encoder))
    loader = photo_loader(encoder)
    photos = [photo for each in folder().categories().values() for photo in each.train]
    system.model.feature_space.fit(loader.sample(photo) for photo in photos)
    found = {}
    for step in STAGES:
        open_window(system, cfg, step)
        system.zero_grad()
        losses, _, pair = system.generator_losses(batch(system), Draws(0, step))
        losses.total.backward()
        grads = [parameter.grad for parameter in system.model.parameters() if parameter.grad is not None]
        terms = {"total": losses.total, **losses.terms, "gradient_norm": torch.nn.utils.get_total_norm(grads)}
        if pair is not None:
            terms |= system.adversary.discriminator_loss(pair)
        found[str(step)] = {name: float(f"{float(value.detach()):.6g}") for name, value in sorted(terms.items())}
    return found


def main() -> None:
    set_threads(1)
    curve = [
        {name: float(f"{value:.6g}") for name, value in sorted(row.items()) if name.startswith("loss/")}
        for row in logged(reference_run())[:CURVE]
    ]
    content = json.dumps({"curve": curve, "stages": stage_losses()}, indent=1)
    (Path(__file__).parent / "tiny.json").write_text(content + "\n")


if __name__ == "__main__":
    main()
