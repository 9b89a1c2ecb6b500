"""How the commands end: success, or one line on stderr that says what was expected, what came and what to do."""

import difflib
import os
import re
import sys
from collections.abc import Callable

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


def run_cli(function: Callable[[], None]) -> None:
    """Run a Hydra entry point and translate every foreseeable error into one line.

    ``FAUNA_DEBUG=1`` shows the full traceback instead.
    """
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # Hydra then raises instead of printing and exiting
    flags = [word for word in sys.argv[1:] if word in ("-m", "--multirun")]  # they may stand anywhere
    sys.argv[1:] = flags[:1] + [word for word in sys.argv[1:] if word not in flags]
    try:
        function()
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)
    except Exception as error:
        message = user_message(error)
        if message is None or os.environ.get("FAUNA_DEBUG"):
            raise
        print(f"fauna: error: {message}", file=sys.stderr)
        sys.exit(getattr(error, "exit_code", EXIT_BAD_INPUT))


def user_message(error: BaseException) -> str | None:
    """One line for errors a user can cause; ``None`` for our own defects."""
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    from fauna.errors import FaunaError

    chain: list[BaseException] = []
    while error is not None and error not in chain:
        chain.append(error)
        error = error.__cause__ or error.__context__  # type: ignore[assignment]
    for link in chain:
        if isinstance(link, FaunaError):
            return str(link)
        unparsed = re.match(r"Error parsing override '(.*)'\n(.*)", str(link))
        if unparsed:
            return f"{unparsed.group(1)}: expected key=value, got something else ({unparsed.group(2)}); e.g. seed=1"
    for link in reversed(chain):
        if isinstance(link, (HydraException, OmegaConfBaseException)) and "Error in call to target" not in str(link):
            return _hydra_message(" ".join(str(link).split()))
    return None


def _hydra_message(text: str) -> str:
    unknown = re.search(r"Could not override '([^']+)'", text) or re.search(r"not in struct full_key: (\S+)", text)
    if unknown:
        return _unknown_key(unknown.group(1))
    option = re.search(r"Could not find '([^']+)/([^'/]+)'.*?Available options in '[^']+':\s*(.*)", text)
    if option:
        group, name, rest = option.groups()
        known = [word for word in re.split(r"\s+", rest) if re.fullmatch(r"\w+", word)]
        known = known[: known.index("Config")] if "Config" in known else known
        return f"{group}: expected one of {', '.join(known)}, got {name!r}; e.g. {group}={known[0] if known else '...'}"
    return f"{text}; see fauna-train --help"


def _unknown_key(key: str) -> str:
    known = _known_keys()
    if key in known:
        return f"{key}: expected a key of this composition, got one that is switched off or belongs to another command"
    close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    hint = f"did you mean {close[0]}?" if close else "see fauna-train --cfg job for all keys"
    return f"{key}: expected a known key, got an unknown one; {hint}"


def _known_keys() -> list[str]:
    """Dotted keys of the default configuration."""
    from hydra import compose, initialize_config_dir
    from hydra.core.global_hydra import GlobalHydra
    from omegaconf import DictConfig, OmegaConf

    from fauna._conf import CONF_DIR

    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        cfg = compose("eval" if "eval" in os.path.basename(sys.argv[0]) else "train")

    def walk(node: DictConfig, prefix: str) -> list[str]:
        keys = []
        for key in node:
            path = f"{prefix}{key}"
            keys.append(path)
            if OmegaConf.is_dict(node._get_node(key)):
                keys += walk(node._get_node(key), f"{path}.")  # type: ignore[arg-type]
        return keys

    return walk(cfg, "")
