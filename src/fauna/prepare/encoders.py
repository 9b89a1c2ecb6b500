"""An encoder by the name of its file in ``conf/encoder``."""

from omegaconf import DictConfig, OmegaConf

from fauna._conf import CONF_DIR
from fauna.encoder.base import Encoder
from fauna.errors import FaunaError


def encoder_by_name(name: str) -> Encoder:
    """The frozen encoder on the CPU.

    Raises:
        FaunaError: for an unknown name, or when its weights cannot be had.
    """
    from fauna.build import build_encoder

    path = CONF_DIR / "encoder" / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(each.stem for each in path.parent.glob("*.yaml")))
        raise FaunaError(f"encoder: expected one of {known}, got {name!r}; e.g. efficientnet_lite0")
    return build_encoder(DictConfig({"encoder": OmegaConf.load(path)}))
