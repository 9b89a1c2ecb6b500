"""From the configuration of ``fauna-eval`` to a filled predictions folder."""

from pathlib import Path
from typing import cast

from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from fauna.build import build_encoder, build_model
from fauna.errors import FaunaError
from fauna.evaluation.gather import Gatherer
from fauna.evaluation.probes import ProbeOptions
from fauna.evaluation.protocol import photos_digest
from fauna.evaluation.subjects import choose
from fauna.evaluation.weights import facts, locate
from fauna.io.checkpoint import load_weights, read_weights
from fauna.threads import set_threads


def predict_checkpoint(cfg: DictConfig, folder: Path) -> None:
    """Predict everything the report needs into ``folder``; goes on where an interrupted evaluation stopped.

    The model is built from the configuration stored with the weights. ``data=...`` replaces the dataset it names,
    ``data.root=...`` and ``data.split=...`` alone change where it lies and which photographs are looked at.

    Raises:
        FaunaError: when checkpoint or dataset cannot be used.
    """
    set_threads(cfg.threads)
    path = locate(cfg.checkpoint)
    metadata = read_weights(path)[1]
    stored = DictConfig(metadata["config"])
    trained_on = OmegaConf.to_container(stored.data.source)
    given = "_target_" in cfg.data or cfg.data.get("root") is not None
    stored.data = _dataset(stored.data, cfg.data)
    stored.data.split = "val"  # unused: the split is chosen below
    stored.data.on_bad = "error"  # nothing is read before its turn; what cannot be used is left out by name
    stored.renderer = cfg.renderer  # not learned: any machine can evaluate what another has trained
    encoder = build_encoder(stored)
    data = instantiate(stored.data, _convert_="all", _partial_=True)(encoder=encoder)
    model = build_model(stored, encoder)
    data.number_species(load_weights(model, path)["species"])
    model.eval()
    subjects = choose(data, split=cfg.data.split, given=given, seed=cfg.seed, max_photos=cfg.max_photos)
    checkpoint = facts(path, metadata)
    source = OmegaConf.to_container(stored.data.source, resolve=True)
    dataset = {"identity": data.source.identity, "sha256": photos_digest(subjects.photos), "source": source}
    dataset["includes_training_photos"] = subjects.split in ("all", "train") and trained_on == source
    gatherer = Gatherer(
        folder=folder,
        model=model,
        fresh_model=lambda: build_model(stored, encoder),
        data=data,
        subjects=subjects,
        facts={"checkpoint": checkpoint, "dataset": dataset},
        size=cfg.size,
    )
    samples = gatherer.samples()
    if not samples:
        reason = gatherer.left_out[0]["reason"]
        raise FaunaError(f"data: expected at least one usable photograph, got none; first problem: {reason}")
    bench = gatherer.predictions(samples, instantiate(stored.losses, _convert_="all"))
    gatherer.baselines(bench, cfg.baselines, seed=cfg.seed, pairs=cfg.pairs)
    gatherer.probes(bench, cfg.probes, ProbeOptions(steps=cfg.probe_steps, lr=cfg.probe_lr), cfg.probe_photos)
    gatherer.finish(
        bench, {"baselines": list(cfg.baselines), "probes": list(cfg.probes), "probe_steps": cfg.probe_steps}
    )


def _dataset(stored: DictConfig, given: DictConfig) -> DictConfig:
    """The stored dataset, or the one of the command line in its place, with the command line's keys on top."""
    if "_target_" in given:
        given.image_size = stored.image_size
        return given
    changes = {key: given[key] for key in given if given[key] is not None and key != "split"}
    if "root" in changes and "root" not in stored.source:
        raise FaunaError(
            f"data.root: expected weights trained on a folder, got {stored.source._target_}; add data=fauna"
        )
    if "root" in changes:
        stored.source.root = changes["root"]
    return cast(DictConfig, OmegaConf.merge(stored, changes))
