"""A small model in the form in which one ships."""

import json
from pathlib import Path

from omegaconf import OmegaConf

from fauna.build import build_encoder, build_model
from fauna.evaluation.gather import FACTS
from fauna.evaluation.report import write_reports
from fauna.evaluation.scoring import ScoreOptions
from fauna.io.checkpoint import load_weights, save_weights
from fauna.pretrained import shipped
from tests.evaluation.objects import write_predictions
from tests.runs import composed, reference_run, tiny


def ship(folder: Path, monkeypatch) -> Path:
    """Put the reference run's weights where the package looks for its model."""
    folder.mkdir(parents=True, exist_ok=True)
    content = (reference_run() / shipped.WEIGHTS).read_bytes()
    (folder / shipped.WEIGHTS).write_bytes(content)
    (folder / shipped.CARD).write_text("# A card\n")
    digests = {name: shipped.sha256((folder / name).read_bytes()) for name in (shipped.WEIGHTS, shipped.CARD)}
    (folder / shipped.INDEX).write_text(json.dumps({"files": digests}))
    monkeypatch.setattr(shipped, "_folder", lambda: folder)
    return folder


def publishable(folder: Path, *, turned: bool = False, **data: object) -> Path:
    """The reference run's weights under the name of a run on the zoo, with places of a machine in its configuration."""
    cfg = composed(*tiny(), "data=zoo_tiny")
    model = build_model(cfg, build_encoder(cfg))
    load_weights(model, reference_run() / shipped.WEIGHTS)
    model.set_turned(turned)
    config = OmegaConf.to_container(cfg, resolve=True)
    assert isinstance(config, dict)
    config["data"] |= {"split_file": "/home/somebody/splits.json", **data}
    config |= {"out": "/home/somebody/runs/7", "name": "blobs"}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / shipped.WEIGHTS
    save_weights(model, path, config=OmegaConf.to_yaml(config), species=["long", "round"], half=True)
    return path


def report_of(weights: Path, folder: Path, *, flip: float | None = 0.0) -> Path:
    """A report of small boxes that says it is of this file, and whether its head is at -z (``None``: nobody knows)."""
    predictions = write_predictions(folder / "predictions", held_out=True)
    facts = json.loads((predictions / FACTS).read_text())
    facts["checkpoint"]["sha256"] = shipped.sha256(weights.read_bytes())
    (predictions / FACTS).write_text(json.dumps(facts))
    write_reports(predictions, folder, ScoreOptions(seed=0, pairs=20, bootstrap=5, settings=()), pictures=1)
    report = json.loads((folder / "report.json").read_text())
    report["metrics"]["global_flip"] = {"value": flip, "low": None, "high": None, "n": 0 if flip is None else 6}
    (folder / "report.json").write_text(json.dumps(report))
    return folder
