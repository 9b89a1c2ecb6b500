"""From a composed configuration to objects: one ``instantiate`` per config group, nothing else."""

import inspect
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from hydra.utils import get_object, instantiate
from omegaconf import DictConfig, OmegaConf

from fauna.configuration import FACTS, MODEL_GROUPS, check_targets
from fauna.discriminator.adversary import Adversary
from fauna.encoder.base import Encoder
from fauna.errors import FaunaError
from fauna.losses.objective import Objective
from fauna.model import FaunaModel
from fauna.stages import Schedule

if TYPE_CHECKING:
    from fauna.system import FaunaSystem


def stored_config(config: Mapping[str, Any]) -> DictConfig:
    """The configuration that weights were saved with, checked against the constructors of this version.

    Raises:
        FaunaError: when a group or an argument is missing, unknown or of another type.
    """
    cfg = DictConfig(config)
    try:
        if missing := [group for group in MODEL_GROUPS if group not in cfg]:
            raise FaunaError(f"{missing[0]}: expected this group, got none")
        for group in MODEL_GROUPS:
            check_targets(cfg[group], group)
    except FaunaError as error:
        raise FaunaError(
            f"checkpoint: expected weights of this version, got others ({error}); use the version that trained them, or train again"
        ) from error
    return cfg


def build_model(cfg: DictConfig, encoder: Encoder) -> FaunaModel:
    """The model of a configuration around an encoder that is already loaded.

    The order is the order of the data flow.
    """
    return FaunaModel(
        encoder=encoder,
        feature_space=_make(cfg.feature_space),
        mask_embedding=_make(cfg.mask_embedding),
        bank=_make(cfg.bank, FACTS["bank"]),
        embedder=_make(cfg.embedder),
        viewpoint=_make(cfg.viewpoint),
        shape=_make(cfg.shape),
        deformation=_make(cfg.deformation),
        rig=_make(cfg.rig),
        articulation=_make(cfg.articulation),
        appearance=_make(cfg.appearance),
        renderer=_make(cfg.renderer),
        camera=OmegaConf.to_container(cfg.camera, resolve=True),  # type: ignore[arg-type]
        feature_lookup=cfg.feature_lookup,
        batch_code=cfg.batch_code,
        shade_fraction=float(cfg.shade_fraction),
    )


def build_encoder(cfg: DictConfig) -> Encoder:
    """The frozen encoder."""
    return _make(cfg.encoder, FACTS["encoder"])


def check_encoder(cfg: DictConfig, encoder: Encoder) -> None:
    """The widths written in YAML are those of the encoder.

    Raises:
        FaunaError: naming the first that is not.
    """
    for key in ("global_dim", "token_dim", "grid_size"):
        if cfg.encoder[key] != getattr(encoder, key):
            raise FaunaError(
                f"encoder.{key}: expected {getattr(encoder, key)} with these settings, got {cfg.encoder[key]}; "
                f"add encoder.{key}={getattr(encoder, key)}"
            )


def build_schedule(cfg: DictConfig) -> Schedule:
    """The schedule, a pure function of the step."""
    return _make(cfg.schedule)


def build_system(cfg: DictConfig, model: FaunaModel) -> "FaunaSystem":
    """What Lightning trains."""
    from fauna.system import FaunaSystem, OptimizerOptions  # brings Lightning, which takes seconds to import

    adversary: Adversary = _make(cfg.discriminator)
    objective: Objective = _make(cfg.losses)
    optimizer: OptimizerOptions = _make(cfg.optimizer)
    return FaunaSystem(model=model, adversary=adversary, objective=objective, optimizer=optimizer, seed=cfg.seed)


def _make(node: DictConfig, facts: tuple[str, ...] = ()) -> Any:
    """Instantiate a node without those of the ``facts`` that its constructor does not take."""
    takes = inspect.signature(get_object(node._target_)).parameters
    plain: dict[str, Any] = OmegaConf.to_container(node, resolve=True)  # type: ignore[assignment]
    return instantiate({key: plain[key] for key in plain if key not in facts or key in takes}, _convert_="all")
