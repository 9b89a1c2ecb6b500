"""How the commands end: success, or one line on stderr that says what was expected, what came and what to do."""

import contextlib
import difflib
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141

_refused: list[int] | None = None
"""Jobs of this process's sweep that were refused; ``None`` in a process that a launcher started."""


def run_cli(function: Callable[[], None], command: str) -> None:
    """Run a Hydra entry point and translate every foreseeable error into one line.

    ``FAUNA_DEBUG=1`` shows the full traceback instead.

    Args:
        function: the entry point.
        command: its name, for hints: ``fauna-train`` or ``fauna-eval``.
    """
    global _refused
    os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # Hydra then raises instead of printing and exiting
    flags = [word for word in sys.argv[1:] if word in ("-m", "--multirun")]  # they may stand anywhere
    sys.argv[1:] = flags[:1] + [word for word in sys.argv[1:] if word not in flags]
    _refused = []
    try:
        with one_line_errors(command):
            function()
            sys.stdout.flush()  # here, where a reader that has gone is met quietly
        if _refused:
            numbers = ", ".join(map(str, _refused))
            _leave(f"expected every job of the sweep to run, got refusals of {numbers}, see above", EXIT_BAD_INPUT)
    except BrokenPipeError:
        _leave_quietly()
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)


@contextlib.contextmanager
def one_line_errors(command: str) -> Iterator[None]:
    """End with one line on stderr and exit code 2 on an error that a user can cause; ``FAUNA_DEBUG=1`` shows the traceback.

    Args:
        command: what was called, for hints.
    """
    try:
        yield
    except Exception as error:
        message = user_message(error, command)
        if message is None or os.environ.get("FAUNA_DEBUG"):
            raise
        _leave(message, getattr(error, "exit_code", EXIT_BAD_INPUT))


@contextlib.contextmanager
def hydra_job(command: str) -> Iterator[None]:
    """The body of a Hydra task. Its foreseeable errors end here, because Hydra would add lines of its own to them.

    A single run ends with the line, and takes the folder that Hydra made for it away again. In a sweep the line names the job and goes
    to its log too, the next job follows, and :func:`run_cli` ends with exit code 2.

    Args:
        command: as for :func:`run_cli`.
    """
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode

    cfg = HydraConfig.get()
    trace = Path(cfg.runtime.output_dir) / f"{cfg.job.name}.log"
    try:
        yield
    except BrokenPipeError:
        _leave_quietly()
    except Exception as error:
        message = user_message(error, command)
        if message is None or os.environ.get("FAUNA_DEBUG") or _refused is None:
            raise
        if cfg.mode == RunMode.RUN or hasattr(error, "exit_code"):
            code = getattr(error, "exit_code", EXIT_BAD_INPUT)
            if code == EXIT_BAD_INPUT:
                _remove_traces(trace)
            _leave(message, code)
        _refused.append(cfg.job.num)
        print(f"fauna: error: job {cfg.job.num} ({cfg.job.override_dirname}): {message}", file=sys.stderr)
        with contextlib.suppress(OSError), trace.open("a", encoding="utf-8") as file:
            file.write(f"refused: {message}\n")


def user_message(error: BaseException, command: str) -> str | None:
    """One line for errors a user can cause; ``None`` for our own defects."""
    from hydra.errors import HydraException, OverrideParseException
    from omegaconf.errors import OmegaConfBaseException

    from fauna.errors import FaunaError

    chain: list[BaseException] = []
    link: BaseException | None = error
    while link is not None and link not in chain:
        chain.append(link)
        link = link.__cause__ or link.__context__
    if isinstance(error, BrokenPipeError):
        return None  # nobody reads any more: no error
    for link in chain:
        if isinstance(link, FaunaError):
            return str(link)
        if isinstance(link, OverrideParseException):
            return _unparsed(link.override, str(link).splitlines()[0])
        if isinstance(link, ValueError) and str(link).startswith("Config group override must be"):
            return f"expected a file of every config group, got null or a value; see {command} --help for their names"
    chain.sort(key=lambda link: "dereferencing" in str(link))  # that one names the key
    for link in reversed(chain):
        if isinstance(link, (HydraException, OmegaConfBaseException)) and "Error in call to target" not in str(link):
            return _hydra_message(" ".join(str(link).split()), command)
    if isinstance(error, OSError) and error.strerror is not None:
        return (
            f"{error.filename or 'a file'}: expected a path that can be used, got an error of the system "
            f"({error.strerror}); check the path, its permissions and the space on the disk"
        )
    return None


def _leave(message: str, code: int) -> NoReturn:
    print(f"fauna: error: {message}", file=sys.stderr)
    sys.exit(code)


def _leave_quietly() -> NoReturn:
    """End because nobody reads the output any more."""
    with contextlib.suppress(OSError):  # what is still buffered must not fail again at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(EXIT_BROKEN_PIPE)


def _remove_traces(log: Path) -> None:
    """Remove a run's folder if it holds nothing but what Hydra wrote before the job began: its log and ``.hydra``."""
    folder = log.parent
    with contextlib.suppress(OSError):
        if {each.name for each in folder.iterdir()} <= {log.name, ".hydra"} and not Path.cwd().is_relative_to(folder):
            shutil.rmtree(folder)


def _unparsed(word: str, reason: str) -> str:
    key, equals, value = word.partition("=")
    if equals and re.fullmatch(r"[+~]{0,2}[\w./@:]+", key):
        return f"{key}: expected a plain value, got {value!r} ({reason}); put it in quotes: {key}=\"'{value}'\""
    return f"{word}: expected key=value, got something else ({reason}); e.g. seed=1"


def _hydra_message(text: str, command: str) -> str:
    value = re.search(r"While dereferencing interpolation '\$\{(\S+)\}': (.*?) full_key", text)
    if value:
        return (
            f"{value.group(1)}: expected another kind of value, got one that does not fit ({value.group(2)}); mend it"
        )
    unknown = re.search(r"Could not override '([^']+)'", text) or re.search(r"not in struct full_key: (\S+)", text)
    if unknown:
        return _unknown_key(unknown.group(1), command)
    option = re.search(r"Could not find '([^']+)/([^'/]+)'.*?Available options in '[^']+':\s*(.*)", text)
    if option:
        group, name, rest = option.groups()
        known = [word for word in re.split(r"\s+", rest) if re.fullmatch(r"\w+", word)]
        known = known[: known.index("Config")] if "Config" in known else known
        return f"{group}: expected one of {', '.join(known)}, got {name!r}; e.g. {group}={known[0] if known else '...'}"
    return f"{text}; see {command} --help"


def _unknown_key(key: str, command: str) -> str:
    known = _known_keys(command)
    if key in known:
        return f"{key}: expected a key of this composition, got one that is switched off or belongs to another command"
    close = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    hint = f"did you mean {close[0]}?" if close else f"see {command} --cfg job for all keys"
    return f"{key}: expected a known key, got an unknown one; {hint}"


def _known_keys(command: str) -> list[str]:
    """Dotted keys of a command's default configuration."""
    from hydra import compose, initialize_config_dir
    from hydra.core.global_hydra import GlobalHydra
    from omegaconf import DictConfig, OmegaConf

    from fauna._conf import CONF_DIR

    GlobalHydra.instance().clear()
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        cfg = compose(command.removeprefix("fauna-"))

    def walk(node: DictConfig, prefix: str) -> list[str]:
        keys = []
        for key in node:
            path = f"{prefix}{key}"
            keys.append(path)
            if OmegaConf.is_dict(node._get_node(key)):
                keys += walk(node._get_node(key), f"{path}.")  # type: ignore[arg-type]
        return keys

    return walk(cfg, "")
