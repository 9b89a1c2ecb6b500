"""``fauna-eval``: losses, silhouette IoU and pictures of a checkpoint or weight file."""

from pathlib import Path
from typing import Any, cast

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from fauna._conf import CONF_DIR
from fauna.cli import run_cli


def main() -> None:
    """Entry point of the command line; bad input ends with one line on stderr and exit code 2."""
    run_cli(_hydra_main)


@hydra.main(config_path=str(CONF_DIR), config_name="eval", version_base="1.3")
def _hydra_main(cfg: DictConfig) -> None:
    evaluate_weights(cfg, Path(HydraConfig.get().runtime.output_dir))


def evaluate_weights(cfg: DictConfig, folder: Path) -> dict[str, Any]:
    """Evaluate ``cfg.weights``; the report goes to ``folder/report.json`` and the pictures to ``folder/pictures.png``.

    The model is built from the configuration stored with the weights; ``+data=...`` and ``+data.root=...`` replace the
    dataset it names.

    Raises:
        FaunaError: when weights or dataset cannot be used.
    """
    from hydra.utils import instantiate

    from fauna.build import build_encoder, build_model
    from fauna.evaluation import evaluate
    from fauna.io.checkpoint import load_weights, read_weights
    from fauna.io.contact_sheet import contact_sheet, save_png
    from fauna.io.run_folder import write_json

    weights = Path(cfg.weights)
    stored = DictConfig(read_weights(weights)[1]["config"])
    stored.data = _dataset(stored.data, cfg)
    encoder = build_encoder(stored)
    data = instantiate(stored.data, _convert_="all", _partial_=True)(encoder=encoder)
    model = build_model(stored, encoder)
    load_weights(model, weights)
    model.eval()
    data.prepare(seed=cfg.seed, report=print)
    photos = data.photos(data.split)[: cfg.max_photos]
    objective = instantiate(stored.losses, _convert_="all")
    metrics = evaluate(model, objective, ((photo.category, data.single(photo)) for photo in photos))
    report = {"weights": str(weights), "split": data.split, "dataset": data.source.identity, "metrics": metrics}
    write_json(report, folder / "report.json")
    save_png(contact_sheet(model, [data.single(p) for p in photos[: cfg.pictures]], 128), folder / "pictures.png")
    _print_table(report, folder)
    return report


def _dataset(stored: DictConfig, cfg: DictConfig) -> DictConfig:
    """The stored dataset with what the command line says of ``data`` in its place or on top of it."""
    given = cfg.get("data")
    if given is None:
        return stored
    if "_target_" not in given:
        return cast(DictConfig, OmegaConf.merge(stored, given))
    given.image_size = stored.image_size
    return given


def _print_table(report: dict[str, Any], folder: Path) -> None:
    metrics = report["metrics"]
    if metrics is None:
        print(f"the split {report['split']!r} of {report['dataset']} has no photos")
        return
    for species, row in metrics["species"].items():
        print(f"{species:20s} {row['num_photos']:5d} photos  IoU {row['iou']:.3f}")
    print(f"{'mean over species':20s} {metrics['num_photos']:5d} photos  IoU {metrics['iou']:.3f}")
    print(f"report and pictures: {folder}")


if __name__ == "__main__":
    main()
