"""``fauna-eval``: every metric, baselines and a report of a checkpoint; ``fauna-eval compare`` and ``table`` for several."""

import difflib
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from fauna._conf import CONF_DIR
from fauna.cli import hydra_job, run_cli, user_message
from fauna.errors import FaunaError

if TYPE_CHECKING:
    from fauna.data.datamodule import PhotoDataModule
    from fauna.encoder.base import Encoder
    from fauna.evaluation.gather import Gatherer
    from fauna.losses.objective import Objective

WORDS = ("compare", "table")


def main() -> None:
    """Entry point of the command line; bad input ends with one line on stderr and exit code 2."""
    word = sys.argv[1] if len(sys.argv) > 1 else ""
    if word in WORDS:
        run_cli({"compare": _compare, "table": _table}[word], "fauna-eval")
    elif re.fullmatch(r"[^-=~+][^=]*", word):
        run_cli(lambda: _refuse(word), "fauna-eval")
    else:
        run_cli(_hydra_main, "fauna-eval")


@hydra.main(config_path=str(CONF_DIR), config_name="eval", version_base="1.3")
def _hydra_main(cfg: DictConfig) -> None:
    with hydra_job("fauna-eval"):
        evaluate(cfg, Path(HydraConfig.get().runtime.output_dir))


def _refuse(word: str) -> None:
    close = difflib.get_close_matches(word, WORDS, n=1)
    hint = f"did you mean fauna-eval {close[0]}?" if close else f"e.g. fauna-eval checkpoint={word}"
    raise FaunaError(f"{word}: expected compare, table or key=value, got another word; {hint}")


def evaluate(cfg: DictConfig, folder: Path) -> dict[str, Any]:
    """Predict (unless ``cfg.predictions`` names a folder of predictions), score, and write the reports into ``folder``.

    Returns:
        The content of ``folder/report.json``.

    Raises:
        FaunaError: when the configuration, the checkpoint or the dataset cannot be used.
    """
    from fauna.evaluation.arguments import check
    from fauna.evaluation.report import write_reports
    from fauna.evaluation.scoring import ScoreOptions

    check(cfg)
    if cfg.predictions is None:
        predictions = folder / "predictions"
        predict_checkpoint(cfg, predictions)
    else:
        predictions = Path(str(cfg.predictions)).expanduser()
    options = ScoreOptions(seed=cfg.seed, pairs=cfg.pairs, bootstrap=cfg.bootstrap, settings=tuple(cfg.settings))
    return write_reports(predictions, folder, options, pictures=cfg.pictures)


def predict_checkpoint(cfg: DictConfig, folder: Path) -> None:
    """Predict everything the report needs into ``folder``; goes on where an interrupted evaluation stopped.

    The model is built from the configuration stored with the weights. ``data=...`` replaces the dataset it names,
    ``data.root=...`` and ``data.split=...`` alone change where it lies and which photographs are looked at.

    Raises:
        FaunaError: when checkpoint or dataset cannot be used.
    """
    from hydra.utils import instantiate

    from fauna.build import build_encoder, build_model, stored_config
    from fauna.configuration import check_targets
    from fauna.evaluation.gather import Gatherer
    from fauna.evaluation.protocol import photo_keys
    from fauna.evaluation.subjects import choose, dataset_facts
    from fauna.evaluation.trained_on import training_photos
    from fauna.evaluation.weights import facts, locate
    from fauna.io.checkpoint import load_weights, read_weights
    from fauna.threads import set_threads

    set_threads(cfg.threads)
    path = locate(str(cfg.checkpoint))
    metadata = read_weights(path)[1]
    stored = stored_config(metadata["config"])
    encoder = build_encoder(stored)
    training = training_photos(stored, metadata["species"], encoder)
    given = "_target_" in cfg.data or cfg.data.get("root") is not None
    stored.data = _dataset(stored.data, cfg.data)
    stored.data.split = "val"  # unused: the split is chosen below
    stored.data.on_bad = "error"  # nothing is read before its turn; what cannot be used is left out by name
    check_targets(stored.data, "data")
    stored.renderer = cfg.renderer  # not learned: any machine can evaluate what another has trained
    data = _open_dataset(stored.data, encoder, given=given)
    model = build_model(stored, encoder)
    data.number_species(load_weights(model, path)["species"])
    model.eval()
    subjects = choose(data, training, split=cfg.data.split, given=given, seed=cfg.seed, max_photos=cfg.max_photos)
    keys = photo_keys(subjects.photos)
    source = OmegaConf.to_container(stored.data.source, resolve=True)
    dataset = dataset_facts(data.source.identity, source, keys, subjects, training)
    gatherer = Gatherer(
        folder=folder,
        model=model,
        fresh_model=lambda: build_model(stored, encoder),
        data=data,
        subjects=subjects,
        keys=keys,
        facts={"checkpoint": facts(path, metadata), "dataset": dataset},
        size=cfg.size,
    )
    _fill(gatherer, cfg, instantiate(stored.losses, _convert_="all"))


def _fill(gatherer: "Gatherer", cfg: DictConfig, objective: "Objective") -> None:
    """All that was asked for, in the order in which one needs the other."""
    from fauna.evaluation.probes import ProbeOptions
    from fauna.metrics.score import SHARED_BASE

    samples = gatherer.samples()
    if not samples:
        reason = gatherer.left_out[-1]["reason"]
        raise FaunaError(f"data: expected at least one usable photograph, got none; first problem: {reason}")
    bench = gatherer.predictions(samples, objective)
    if SHARED_BASE in cfg.settings:
        gatherer.shared_base(bench)
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


def _open_dataset(config: DictConfig, encoder: "Encoder", *, given: bool) -> "PhotoDataModule":
    """The photographs; ``given``: by the command line, else they are those of the training, which need not lie on this machine.

    Raises:
        FaunaError: when they cannot be opened.
    """
    from hydra.utils import instantiate

    try:
        return instantiate(config, _convert_="all", _partial_=True)(encoder=encoder)
    except Exception as error:
        reason = user_message(error, "fauna-eval")
        if given or reason is None:
            raise
        raise FaunaError(
            "data: expected a dataset, as that of the training is not on this machine, got none; add data=zoo, or data=fauna "
            "data.root=FOLDER for photographs of your own, or data.root=FOLDER for those of the training "
            f"({reason.split(';')[0].split(': ')[-1]})"
        ) from error


def _compare() -> None:
    from fauna.evaluation.compare import compare_command

    compare_command(sys.argv[2:])


def _table() -> None:
    from fauna.evaluation.table import table_command

    table_command(sys.argv[2:], evaluate_run)


def evaluate_run(run: Path, out: Path, overrides: list[str]) -> dict[str, Any]:
    """Evaluate the newest weights of a run, for ``fauna-eval table``."""
    from hydra import compose, initialize_config_dir
    from hydra.core.global_hydra import GlobalHydra

    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        cfg = compose("eval", overrides=overrides)
    cfg.checkpoint, cfg.out = str(run), str(out)
    return evaluate(cfg, out)


if __name__ == "__main__":
    main()
