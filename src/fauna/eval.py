"""``fauna-eval``: losses, silhouette IoU and pictures of a checkpoint or weight file."""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from fauna._conf import CONF_DIR
from fauna.cli import run_cli
from fauna.errors import FaunaError
from fauna.limits import check_ranges


def main() -> None:
    """Entry point of the command line; bad input ends with one line on stderr and exit code 2."""
    run_cli(_hydra_main)


@hydra.main(config_path=str(CONF_DIR), config_name="eval", version_base="1.3")
def _hydra_main(cfg: DictConfig) -> None:
    evaluate_weights(cfg, Path(HydraConfig.get().runtime.output_dir))


def evaluate_weights(cfg: DictConfig, folder: Path) -> dict[str, Any]:
    """Evaluate ``cfg.weights``; the report goes to ``folder/report.json`` and the pictures to ``folder/pictures.png``.

    The model is built from the configuration stored with the weights. ``data=...`` replaces the dataset it names,
    ``data.root=...`` and ``data.split=...`` alone change where it lies and which photos are looked at.

    Raises:
        FaunaError: when weights or dataset cannot be used.
    """
    from hydra.utils import instantiate

    from fauna.build import build_encoder, build_model
    from fauna.evaluation.summary import evaluate
    from fauna.io.checkpoint import load_weights, read_weights
    from fauna.io.contact_sheet import contact_sheet, save_png
    from fauna.io.run_folder import write_json
    from fauna.threads import set_threads

    check_ranges(cfg)
    if cfg.data.split not in (None, "train", "val", "test", "held_out"):
        raise FaunaError(f"data.split: expected train, val, test or held_out, got {cfg.data.split!r}; choose one")
    for key in ("max_photos", "pictures", "threads"):
        if cfg[key] is not None and not isinstance(cfg[key], int):
            raise FaunaError(f"{key}: expected a whole number, got {cfg[key]!r}; e.g. {key}=12")
    set_threads(cfg.threads)
    weights = Path(cfg.weights)
    stored = DictConfig(read_weights(weights)[1]["config"])
    stored.data = _dataset(stored.data, cfg.data)
    stored.renderer = cfg.renderer  # not learned: any machine can evaluate what another has trained
    encoder = build_encoder(stored)
    data = instantiate(stored.data, _convert_="all", _partial_=True)(encoder=encoder)
    model = build_model(stored, encoder)
    data.number_species(load_weights(model, weights)["species"])
    model.eval()
    data.prepare(seed=cfg.seed, report=print)
    photos = data.photos(data.split)[: cfg.max_photos]
    if not photos:
        raise FaunaError(
            f"data.split: expected a split with photos in {data.source.identity}, got {data.split}, which has none; "
            "choose train, val, test or held_out"
        )
    objective = replace(instantiate(stored.losses, _convert_="all"), weighting="uniform")
    metrics = evaluate(model, objective, ((photo.category, data.single(photo)) for photo in photos))
    report = {"weights": str(weights), "split": data.split, "dataset": data.source.identity, "metrics": metrics}
    write_json(report, folder / "report.json")
    save_png(contact_sheet(model, [data.single(p) for p in photos[: cfg.pictures]], 128), folder / "pictures.png")
    _print_table(report, folder)
    return report


def _dataset(stored: DictConfig, given: DictConfig) -> DictConfig:
    """The stored dataset, or the one of the command line in its place, with the command line's keys on top."""
    if "_target_" in given:
        given.image_size = stored.image_size
        return given
    changes = {key: given[key] for key in given if given[key] is not None}
    if "root" in changes and "root" not in stored.source:
        raise FaunaError(
            f"data.root: expected weights trained on a folder, got {stored.source._target_}; add data=fauna"
        )
    if "root" in changes:
        stored.source.root = changes["root"]
    return cast(DictConfig, OmegaConf.merge(stored, changes))


def _print_table(report: dict[str, Any], folder: Path) -> None:
    metrics = report["metrics"]
    for species, row in metrics["species"].items():
        print(f"{species:20s} {row['num_photos']:5d} photos  IoU {row['iou']:.3f}")
    print(f"{'mean over species':20s} {metrics['num_photos']:5d} photos  IoU {metrics['iou']:.3f}")
    print(f"report and pictures: {folder}")


if __name__ == "__main__":
    main()
