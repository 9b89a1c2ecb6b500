"""``fauna-demo``: starts the page. Heavy imports happen once the arguments are right."""

import argparse
import importlib.util
import os
import signal
import socket
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from fauna.cli import EXIT_INTERRUPTED, one_line_errors
from fauna.errors import FaunaError

COMMAND = "fauna-demo"
EXIT_TERMINATED = 143


@dataclass(frozen=True)
class Options:
    """What can be chosen.

    Attributes:
        host: address that is listened on.
        port: 0 takes a free one.
        max_upload_mb: of a photograph.
        max_waiting: photographs that may wait; further ones are turned away.
        checkpoint: weights, ``None`` for the model in the package.
        segmenter: for photographs without an alpha channel, ``None`` for that of ``conf/reconstruct.yaml``.
        device: where torch computes.
    """

    host: str
    port: int
    max_upload_mb: int
    max_waiting: int
    checkpoint: str | None
    segmenter: str | None
    device: str


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        print(f"fauna: error: {message}; see {COMMAND} --help", file=sys.stderr)
        sys.exit(2)


def main() -> None:
    """Entry point of the command line."""
    options = parse(sys.argv[1:])
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(EXIT_TERMINATED))  # so that the folder is removed
    try:
        with one_line_errors(COMMAND):
            _serve(options)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)


def parse(arguments: Sequence[str]) -> Options:
    """The command line; ends the program on a bad one, and after ``--help``."""
    parser = _Parser(
        prog=COMMAND,
        description="A page on this computer: drag a photograph in, get a 3D animal. Needs no network and sends nothing anywhere.",
    )
    add = parser.add_argument
    add(
        "--host",
        default="127.0.0.1",
        help="address to listen on; others than this computer only on purpose (default: %(default)s)",
    )
    add("--port", type=int, default=7860, help="0 takes a free one (default: %(default)s)")
    add("--max-upload-mb", type=int, default=20, metavar="N", help="largest photograph (default: %(default)s)")
    add("--max-waiting", type=int, default=16, metavar="N", help="photographs that may wait (default: %(default)s)")
    add("--checkpoint", metavar="FILE", help="weights, checkpoint or run folder (default: the model in the package)")
    add(
        "--segmenter", metavar="NAME", help="for photographs without alpha channel: grabcut, sam[:MODEL], rembg[:MODEL]"
    )
    add("--device", default="cpu", help="where torch computes (default: %(default)s)")
    return Options(**vars(parser.parse_args(arguments)))


def check(options: Options) -> None:
    """Refuse what cannot be started, before anything is loaded.

    Raises:
        FaunaError: when Gradio is missing or a number is out of range.
    """
    for name, value, low, high in (
        ("--port", options.port, 0, 65535),
        ("--max-upload-mb", options.max_upload_mb, 1, 1000),
        ("--max-waiting", options.max_waiting, 1, 1000),
    ):
        if not low <= value <= high:
            raise FaunaError(f"{name}: expected a whole number from {low} to {high}, got {value}; give another number")
    if importlib.util.find_spec("gradio") is None:
        raise FaunaError(f"{COMMAND}: expected the package gradio, got none; pip install -e '.[demo]' in the checkout")


def _serve(options: Options) -> None:
    check(options)
    listener = _listen(options.host, options.port)
    os.environ["GRADIO_ANALYTICS_ENABLED"] = "False"
    os.environ["HF_HUB_DISABLE_TELEMETRY"] = "1"
    with tempfile.TemporaryDirectory(prefix="fauna-demo-") as folder:
        os.environ["GRADIO_TEMP_DIR"] = folder  # read when Gradio is imported: the only folder whose files are served
        import uvicorn  # pyright: ignore[reportMissingImports]

        from fauna.demo.app import build_app
        from fauna.demo.studio import Studio

        print("fauna: loading the model ...", flush=True)
        studio = Studio.load(options.checkpoint, device=options.device, segmenter=options.segmenter)
        app = build_app(
            studio,
            Path(folder),
            max_upload=options.max_upload_mb * 2**20,
            max_waiting=options.max_waiting,
            host=options.host,
        )
        shown = f"[{options.host}]" if ":" in options.host else options.host
        print(f"fauna: http://{shown}:{listener.getsockname()[1]}  (Ctrl+C ends it)", flush=True)
        server = uvicorn.Server(uvicorn.Config(app, log_level="warning", timeout_graceful_shutdown=2))
        server.run(sockets=[listener])


def _listen(host: str, port: int) -> socket.socket:
    """A socket that listens already: a port in use is found before the model is loaded, and visitors wait until it is."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listener = socket.socket(family, kind, protocol)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(128)
    except OSError as error:
        reason = error.strerror or str(error)
        raise FaunaError(
            f"--host, --port: expected an address to listen on, got {host} {port} ({reason}); give another, e.g. --port 0"
        ) from error
    return listener


if __name__ == "__main__":
    main()
