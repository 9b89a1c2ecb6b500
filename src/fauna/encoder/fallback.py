"""Replaces an encoder whose weights cannot be had, before anything takes its widths from the configuration."""

from hydra import compose
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, open_dict

from fauna.encoder.registry import resolve_encoder


def with_available_encoder(cfg: DictConfig, overrides: list[str], config_name: str = "train") -> DictConfig:
    """The same configuration, recomposed with ``encoder.offline_fallback`` when the encoder's weights cannot be had.

    Args:
        cfg: as composed; Hydra must be initialised.
        overrides: the command line it was composed with.
        config_name: of the primary configuration.

    Raises:
        EncoderUnavailable: when there is no fallback, or it cannot be had either.
    """
    requested = cfg.encoder.name
    available = resolve_encoder(requested, cfg.encoder.offline_fallback)
    if available == requested:
        return cfg
    kept = [text for text in overrides if not text.startswith(("encoder=", "encoder."))]
    if not any(text.startswith("feature_space=") for text in kept):
        kept.append("feature_space=standardized")  # pooled convolutional features are all positive: raw cosines bunch
    recomposed = compose(config_name, overrides=[*kept, f"encoder={available}"])
    with open_dict(recomposed):
        recomposed.encoder.replaces = requested
        if HydraConfig.initialized() and "out" in cfg:
            recomposed.out = cfg.out
    return recomposed
