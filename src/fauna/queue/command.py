"""``fauna-queue NAME out=FOLDER``: train and evaluate every run of a queue, and write its table."""

import sys
from pathlib import Path

from fauna.cli import EXIT_INTERRUPTED, one_line_errors
from fauna.errors import FaunaError
from fauna.queue.plan import read_plan
from fauna.queue.runner import Interrupted, work

USAGE = """usage: fauna-queue NAME out=FOLDER [key=value ...]

NAME is a file of conf/queue (ablation), or a .yaml file like those. Keys are those of the file. Give the same folder again to go on
after an interruption; several commands may share one. table=only writes the table of what is there."""
EXIT_FAILED = 1


def main() -> None:
    """Entry point. Exit codes: 0 all runs done, 1 some failed, 2 bad arguments, 128 + n after signal n."""
    arguments = sys.argv[1:]
    if not arguments or arguments[0] in ("-h", "--help"):
        print(USAGE)
        return
    with one_line_errors("fauna-queue"):
        try:
            failed = _queue(arguments)
        except Interrupted as interrupted:
            print("fauna-queue: interrupted; the same command goes on", file=sys.stderr)
            sys.exit(128 + interrupted.args[0])
        except KeyboardInterrupt:  # between two commands
            print("fauna-queue: interrupted; the same command goes on", file=sys.stderr)
            sys.exit(EXIT_INTERRUPTED)
    if failed:
        print("\n".join(["fauna-queue: failed:", *failed]), file=sys.stderr)
        sys.exit(EXIT_FAILED)


def _queue(arguments: list[str]) -> list[str]:
    name, words = arguments[0], arguments[1:]
    own = dict(word.split("=", 1) for word in words if word.startswith(("out=", "table=")))
    if "=" in name or not own.get("out"):
        raise FaunaError(
            f"fauna-queue: expected NAME out=FOLDER, got {' '.join(arguments)}; e.g. fauna-queue ablation out=runs/ablation"
        )
    if own.get("table", "only") != "only":
        raise FaunaError(f"table: expected only, got {own['table']!r}; leave it out to train")
    out = Path(own["out"]).expanduser()
    plan = read_plan(name, [word for word in words if not word.startswith(("out=", "table="))])
    failed = [] if "table" in own else work(plan, out, say=lambda text: print(text, flush=True))
    from fauna.queue.summary import markdown, summarise  # after the trainings: it loads much

    print(markdown(plan, summarise(plan, out)))
    print(f"table: {out / 'table.md'}")
    return failed


if __name__ == "__main__":
    main()
