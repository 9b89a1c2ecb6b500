"""``fauna-bank``: what a Semantic Bank holds, drawn and measured. Heavy imports happen once there is work to do."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from fauna.cli import EXIT_INTERRUPTED, one_line_errors
from fauna.errors import FaunaError

COMMAND = "fauna-bank"
EXIT_NOT_ALL_OK = 1
EPILOG = """DATA names a dataset as for fauna-eval: data=zoo, or data=fauna data.root=FOLDER, and keys of it.
exit codes: 0 done; 1 some samples gave no animal, result.json says why; 2 bad arguments; 130 interrupted. Details: docs/reconstruct.md"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        print(f"fauna: error: {message}; see {COMMAND} --help", file=sys.stderr)
        sys.exit(2)


def main() -> None:
    """Entry point of the command line."""
    given = parse(sys.argv[1:])
    try:
        with one_line_errors(COMMAND):
            if given.threads < 1:
                raise FaunaError(f"--threads: expected a number >= 1, got {given.threads}; e.g. 2")
            from fauna.bank import jobs

            work = {"sample": jobs.sample, "species": jobs.species, "table": jobs.table}
            whole = work[given.task](given)
            sys.stdout.flush()
    except KeyboardInterrupt:
        print("fauna: interrupted; nothing half-written is left", file=sys.stderr)
        sys.exit(EXIT_INTERRUPTED)
    sys.exit(0 if whole else EXIT_NOT_ALL_OK)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The command line; ends the program on a bad one, and after ``--help``."""
    parser = _Parser(
        prog=COMMAND,
        description="Draw and measure what the Semantic Bank of a model holds.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    tasks = parser.add_subparsers(dest="task", required=True, metavar="TASK")
    sample = tasks.add_parser("sample", help="bodies of every slot and of random mixtures: bank.png and GLBs")
    sample.add_argument("--mixtures", type=int, default=10, metavar="N", help="of ten and of all slots (default: 10)")
    sample.add_argument("--seed", type=int, default=0, metavar="N", help="of the mixtures (default: 0)")
    species = tasks.add_parser("species", help="which species share slots: pictures and numbers")
    between = {"nargs": 2, "metavar": ("SPECIES", "SPECIES"), "default": ("horse", "elephant")}
    species.add_argument("--between", **between, help="shapes between two species (default: horse elephant)")
    species.add_argument("--photos", type=int, default=24, metavar="N", help="of each species of DATA (default: 24)")
    species.add_argument(
        "data", nargs="*", metavar="DATA", help="default: the answers beside the weights, or data=zoo without any"
    )
    table = tasks.add_parser(
        "table", help="ask the bank about the pictures it learned from; writes bank.safetensors beside the weights"
    )
    table.add_argument("--held-out", type=int, default=25, metavar="N", help="also of each other species of the zoo")
    table.add_argument("data", nargs="*", metavar="KEY=VALUE", help="of the training's data, e.g. data.root=FOLDER")
    for task, out in ((sample, "bank"), (species, "species")):
        task.add_argument("-o", "--out", type=Path, default=Path(out), metavar="DIR", help="default: %(default)s")
        task.add_argument("--overwrite", action="store_true", help="replace results of other options")
    table.add_argument("-o", "--out", type=Path, metavar="FILE", help="default: bank.safetensors beside the weights")
    for task in (sample, species, table):
        task.add_argument(
            "--checkpoint", metavar="FILE", help="weights, checkpoint or run (default: the shipped model)"
        )
        task.add_argument("--device", default="cpu", help="where torch computes (default: %(default)s)")
        task.add_argument("--threads", type=int, default=1, metavar="N", help="CPU threads (default: %(default)s)")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    main()
