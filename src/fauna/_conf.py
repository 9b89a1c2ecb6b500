"""Where the Hydra configuration lives: inside the wheel, or beside ``src`` in a checkout."""

from pathlib import Path

_PACKAGED = Path(__file__).parent / "conf"
_CHECKOUT = Path(__file__).parents[2] / "conf"
CONF_DIR = _PACKAGED if _PACKAGED.is_dir() else _CHECKOUT
