"""``fauna-eval``: every metric, baselines and a report of a checkpoint; ``fauna-eval compare`` and ``table`` for several."""

import sys
from pathlib import Path
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from fauna._conf import CONF_DIR
from fauna.cli import run_cli
from fauna.errors import FaunaError
from fauna.limits import check_ranges

WHOLE = ("max_photos", "pictures", "threads", "size", "pairs", "bootstrap", "probe_steps", "probe_photos")
MAY_BE_NULL = ("max_photos", "threads")


def main() -> None:
    """Entry point of the command line; bad input ends with one line on stderr and exit code 2."""
    words = {"compare": _compare, "table": _table}
    if len(sys.argv) > 1 and sys.argv[1] in words:
        run_cli(lambda: words[sys.argv[1]](sys.argv[2:]))
    else:
        run_cli(_hydra_main)


@hydra.main(config_path=str(CONF_DIR), config_name="eval", version_base="1.3")
def _hydra_main(cfg: DictConfig) -> None:
    evaluate(cfg, Path(HydraConfig.get().runtime.output_dir))


def evaluate(cfg: DictConfig, folder: Path) -> dict[str, Any]:
    """Predict (unless ``cfg.predictions`` names a folder of predictions), score, and write the reports into ``folder``.

    Returns:
        The content of ``folder/report.json``.

    Raises:
        FaunaError: when the configuration, the checkpoint or the dataset cannot be used.
    """
    check(cfg)
    from fauna.evaluation.checkpoint_run import predict_checkpoint
    from fauna.evaluation.report import write_reports
    from fauna.evaluation.scoring import ScoreOptions

    if cfg.predictions is None:
        predictions = folder / "predictions"
        predict_checkpoint(cfg, predictions)
    else:
        predictions = Path(cfg.predictions)
    options = ScoreOptions(seed=cfg.seed, pairs=cfg.pairs, bootstrap=cfg.bootstrap, settings=tuple(cfg.settings))
    return write_reports(predictions, folder, options, pictures=cfg.pictures)


def check(cfg: DictConfig) -> None:
    """Refuse what cannot work before anything is loaded.

    Raises:
        FaunaError: naming the key.
    """
    check_ranges(cfg)
    if (cfg.checkpoint is None) == (cfg.predictions is None):
        got = "neither" if cfg.checkpoint is None else "both"
        raise FaunaError(f"checkpoint: expected either checkpoint=PATH or predictions=DIR, got {got}; give one of them")
    for key in WHOLE:
        value = cfg[key]
        if value is None and key in MAY_BE_NULL:
            continue
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise FaunaError(f"{key}: expected a whole number >= 1, got {value!r}; e.g. {key}=12")
    from fauna.evaluation.baselines import check_baselines
    from fauna.evaluation.probes import check_probes
    from fauna.evaluation.subjects import SPLITS

    if cfg.data.split not in (None, *SPLITS):
        raise FaunaError(f"data.split: expected one of {', '.join(SPLITS)}, got {cfg.data.split!r}; choose one")
    check_baselines(cfg.baselines)
    check_probes(cfg.probes)


def _compare(arguments: list[str]) -> None:
    from fauna.evaluation.compare import compare_command

    compare_command(arguments)


def _table(arguments: list[str]) -> None:
    from fauna.evaluation.table import table_command

    table_command(arguments, evaluate_run)


def evaluate_run(run: Path, out: Path, overrides: list[str]) -> dict[str, Any]:
    """Evaluate the newest weights of a run, for ``fauna-eval table``."""
    from hydra import compose, initialize_config_dir
    from hydra.core.global_hydra import GlobalHydra

    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        quoted = [f"checkpoint='{run}'", f"out='{out}'"]
        cfg = compose("eval", overrides=[*overrides, *quoted])
    return evaluate(cfg, out)


if __name__ == "__main__":
    main()
