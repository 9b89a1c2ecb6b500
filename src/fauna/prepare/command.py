"""``fauna-prepare``: photographs in, a training set out. Heavy imports happen once there is work to do."""

import argparse
import contextlib
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import NoReturn

from fauna.cli import EXIT_BAD_INPUT, EXIT_BROKEN_PIPE, EXIT_INTERRUPTED, one_line_errors

COMMAND = "fauna-prepare"
EXIT_NOT_SOUND, EXIT_TERMINATED = 1, 143
COMMANDS = {
    "all": "every step below but pack, one after the other",
    "scan": "list SOURCE; digests, sizes, EXIF, duplicates, near-identical frames",
    "mask": "masks: given, alpha channels, or of a segmenter",
    "crop": "square crops around the animals",
    "filter": "reject what is blurred, cut, hidden ...; contact sheets of it",
    "features": "feature maps",
    "split": "training, validation and test photographs; writes DEST and its manifest",
    "check": "audit a finished set: fauna-prepare check DEST",
    "pack": "shards for large sets: fauna-prepare pack DEST PACKED",
}
FOLDERS = {"check": ("DEST",), "pack": ("DEST", "PACKED")}
EPILOG = """exit codes: 0 done; 1 check found faults; 2 bad arguments, or something that cannot be read or written;
130, 143 interrupted. Run the same command again to go on: finished photographs are not looked at again.
Keys and their values: conf/prepare.yaml. Details: docs/prepare.md"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        print(f"fauna: error: {message}; see {COMMAND} --help", file=sys.stderr)
        sys.exit(EXIT_BAD_INPUT)


def main() -> None:
    """Entry point of the command line."""
    given = parse(sys.argv[1:])
    signal.signal(signal.SIGTERM, _terminate)
    try:
        with one_line_errors(COMMAND):
            code = _run(given)
            sys.stdout.flush()
    except KeyboardInterrupt:
        print("fauna: interrupted; the same command goes on where it was", file=sys.stderr)
        sys.exit(EXIT_INTERRUPTED)
    except BrokenPipeError:  # nobody reads any more
        with contextlib.suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(EXIT_BROKEN_PIPE)
    sys.exit(code)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The command line; ends the program on a bad one, and after ``--help``."""
    parser = _Parser(
        prog=COMMAND,
        description="Make a training set out of photographs of animals.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    steps = parser.add_subparsers(dest="step", required=True, metavar="STEP", parser_class=_Parser)
    for name, text in COMMANDS.items():
        step = steps.add_parser(name, help=text, description=text, epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
        for folder in FOLDERS.get(name, ("SOURCE", "DEST")):
            step.add_argument(folder.lower(), type=Path, metavar=folder)
        step.add_argument("settings", nargs="*", metavar="KEY=VALUE", help="see conf/prepare.yaml; e.g. crop.size=512")
    return parser.parse_args(arguments)


def _run(given: argparse.Namespace) -> int:
    from fauna.prepare.settings import prepare_settings

    settings = prepare_settings(given.settings)
    if given.step == "check":
        from fauna.prepare.check import check_set

        return 0 if check_set(given.dest.expanduser(), settings) else EXIT_NOT_SOUND
    if given.step == "pack":
        from fauna.prepare.pack import pack_set

        pack_set(given.dest.expanduser(), given.packed.expanduser(), settings)
        return 0
    from fauna.prepare.runs import prepare

    return 0 if prepare(given.step, given.source.expanduser(), given.dest.expanduser(), settings) else EXIT_NOT_SOUND


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    sys.exit(EXIT_TERMINATED)


if __name__ == "__main__":
    main()
