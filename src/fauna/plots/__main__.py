"""``python -m fauna.plots RUN [RUN ...] --out curves.png`` draws losses and metrics over the steps of runs."""

import argparse
from pathlib import Path

from fauna.cli import one_line_errors


def main() -> None:
    """Parse the command line and write the picture."""
    parser = argparse.ArgumentParser(description="Curves of training runs, with the switches of their schedules.")
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN", help="folder of a run; several lie over each other"
    )
    parser.add_argument("--out", required=True, type=Path, help="PNG to write")
    parser.add_argument("--smooth", type=int, default=9, help="entries of the log in a running mean (default 9)")
    given = parser.parse_args()

    with one_line_errors("python -m fauna.plots"):
        from fauna.plots.curves import draw
        from fauna.plots.log import read_run

        draw([read_run(folder) for folder in given.runs], given.out, smooth=given.smooth)
        print(f"curves: {given.out}")


if __name__ == "__main__":
    main()
