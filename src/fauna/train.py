"""``fauna-train``: compose, build, fit. Heavy imports happen only once there is something to train."""

import inspect
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from fauna._conf import CONF_DIR
from fauna.cli import hydra_job, run_cli
from fauna.errors import FaunaError, Interrupted

if TYPE_CHECKING:
    from lightning import Trainer

    from fauna.data.datamodule import PhotoDataModule
    from fauna.stages import Schedule
    from fauna.system import FaunaSystem


def main() -> None:
    """Entry point of the command line; bad input ends with one line on stderr and exit code 2."""
    run_cli(_hydra_main, "fauna-train")


@hydra.main(config_path=str(CONF_DIR), config_name="train", version_base="1.3")
def _hydra_main(cfg: DictConfig) -> None:
    with hydra_job("fauna-train"):
        from fauna.encoder.fallback import with_available_encoder

        hydra_config = HydraConfig.get()
        available = with_available_encoder(cfg, list(hydra_config.overrides.task))
        train(available, Path(hydra_config.runtime.output_dir))


def train(cfg: DictConfig, folder: Path) -> dict[str, Any]:
    """Run one training from a composed configuration.

    Args:
        cfg: of ``conf/train.yaml``.
        folder: where checkpoints, pictures, logs and ``result.json`` go.

    Returns:
        The content of ``result.json``.

    Raises:
        FaunaError: on bad configuration or data, before any work starts where that can be known.
    """
    from lightning import seed_everything

    from fauna.build import build_encoder, build_model, build_schedule, build_system, check_encoder
    from fauna.callbacks.interrupt import Interrupt
    from fauna.configuration import validate
    from fauna.io.run_folder import check_fits, claim_folder, report_changes, resume_path, write_json
    from fauna.threads import describe_cpu

    validate(cfg)
    weights = weights_to_start_from(cfg.init_from)
    resume = resume_path(cfg.resume, folder)
    claim_folder(folder, resume)
    config = OmegaConf.to_yaml(cfg, resolve=True)
    seed_everything(cfg.seed, workers=False, verbose=False)
    schedule = build_schedule(cfg)
    encoder = build_encoder(cfg)
    check_encoder(cfg, encoder)
    data = _make(cfg.data, {"encoder": encoder})
    system = build_system(cfg, build_model(cfg, encoder))
    given = {"schedule": schedule, "folder": str(folder), "config": config, "save_dir": str(folder)}
    interrupt = Interrupt()
    callbacks = [*(_make(node, given) for node in cfg.callbacks.values() if node is not None), interrupt]
    loggers = [_make(node, given) for node in cfg.logger.values() if node is not None]
    trainer = _make(cfg.trainer, {**given, "callbacks": callbacks, "logger": loggers})
    print(f"encoder {encoder.name}, {encoder.input_size} px, {encoder.dtype}; CPU: {describe_cpu()}")
    data.prepare(seed=cfg.seed, report=print)
    data.check_trainable()
    if resume is not None:
        check_fits(resume, system.state_dict(), [each.state_dict() for each in system.configure_optimizers()])
        report_changes(resume, config, data.photos_digest(), encoder.fingerprint)
    encoder.to(trainer.strategy.root_device)
    if resume is None:
        _start(cfg, weights, system, data)
    baseline = _validate(trainer, system, data, schedule) if resume is None else None
    started = time.monotonic()
    try:
        with interrupt.listening():
            trainer.fit(system, datamodule=data, ckpt_path=None if resume is None else str(resume), weights_only=True)
            interrupt.raise_if_asked()
    except (SystemExit, KeyboardInterrupt) as stop:  # Lightning turns both signals into an exit of its own
        terminated = bool(getattr(trainer, "received_sigterm", False))
        raise Interrupted(
            f"training was interrupted at step {trainer.global_step}; continue with resume=auto out={folder}",
            143 if terminated else 130,
        ) from stop
    result = {
        "steps": trainer.global_step,
        "fit_seconds": round(time.monotonic() - started, 1),
        "untrained": baseline,
        "trained": _validate(trainer, system, data, None),
    }
    for logger in loggers:
        logger.finalize("success")
    if trainer.is_global_zero:
        write_json(result, folder / "result.json")
        _say_where(folder, result, data.split)
    return result


def _make(node: DictConfig, given: dict[str, Any]) -> Any:
    """Instantiate a node and hand it those of the ``given`` objects that its signature asks for."""
    from hydra.utils import get_object, instantiate

    wanted = inspect.signature(get_object(node._target_)).parameters
    passed = {name: value for name, value in given.items() if name in wanted}
    return instantiate(node, _convert_="all", _partial_=True)(**passed)


def weights_to_start_from(init_from: str | None) -> Path | None:
    """The file that ``init_from`` names, found before photographs are read.

    Raises:
        FaunaError: when it does not exist, or no model ships with this version.
    """
    from fauna.evaluation.weights import locate

    if init_from is None:
        return None
    try:
        return locate(init_from)
    except FaunaError as error:
        raise FaunaError(f"init_from: {str(error).removeprefix('checkpoint: ')}") from error


def _start(cfg: DictConfig, weights: Path | None, system: "FaunaSystem", data: "PhotoDataModule") -> None:
    """Weights to start from, and the feature space: theirs, or fitted on the training photos."""
    from fauna.bank.category import CategoryBank
    from fauna.io.checkpoint import load_weights, read_weights

    model = system.model
    if weights is not None:
        theirs = read_weights(weights)[1]
        same_encoder = theirs["encoder"] == model.encoder.fingerprint
        chosen = cfg.init_components
        takes_bank = chosen is None or "bank" in chosen
        if takes_bank and isinstance(model.bank, CategoryBank) and theirs["species"] != data.train_species:
            raise FaunaError(
                f"init_from: expected weights of the same species for bank=category, got {theirs['species']} instead of "
                f"{data.train_species}; leave the bank out of init_components or use bank=semantic"
            )
        if chosen is None or same_encoder:
            _check_feature_space(weights, theirs["config"], cfg)
            load_weights(model, weights, None if chosen is None else sorted({*chosen, "feature_space"}))
            return
        load_weights(model, weights, list(chosen))  # another encoder: its features need their own statistics
    model.feature_space.fit(data.feature_samples())


def _check_feature_space(weights: Path, theirs: dict[str, Any], cfg: DictConfig) -> None:
    """Refuse to read features in another way than the weights did that bring their statistics."""
    wanted = OmegaConf.to_container(cfg.feature_space, resolve=True)
    stored = theirs.get("feature_space") or {}
    assert isinstance(wanted, dict)
    for key in sorted(str(key) for key in wanted if key != "max_images"):
        if stored.get(key) != wanted[key]:
            raise FaunaError(
                f"init_from: expected weights of the feature space that is composed, got {weights} with {key} "
                f"{stored.get(key)} instead of {wanted[key]}; add feature_space.{key}={stored.get(key)}, or use other weights"
                if key in stored
                else f"init_from: expected weights of this version, got {weights} without feature_space.{key}; train them again"
            )


def _validate(
    trainer: "Trainer", system: "FaunaSystem", data: "PhotoDataModule", schedule: "Schedule | None"
) -> dict[str, Any] | None:
    """Metrics on the validation split, per species; not for runs too short to be validated."""
    from fauna.evaluation.summary import evaluate

    if trainer.max_steps < trainer.val_check_interval or not trainer.is_global_zero:
        return None
    if schedule is not None:
        system.model.set_stage(schedule.at(0))
    system.to(trainer.strategy.root_device)
    photos = data.photos(data.split)[: int(trainer.limit_val_batches)]
    objective = replace(system.objective, weighting="uniform")
    return evaluate(system.model, objective, ((photo.category, data.single(photo)) for photo in photos))


def _say_where(folder: Path, result: dict[str, Any], split: str) -> None:
    print(f"run folder: {folder}")
    if (folder / "pictures").is_dir():
        print(f"pictures:   {folder / 'pictures'} (one contact sheet per stage)")
    print(f"weights:    {folder / 'weights.safetensors'}")
    for name in ("untrained", "trained"):
        if result[name]:
            photos = "training photos" if split == "train" else "photos not trained on"
            print(f"silhouette IoU on {photos}, {name}: {result[name]['iou']:.3f}")


if __name__ == "__main__":
    main()
