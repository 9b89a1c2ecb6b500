"""Runs the notebooks from top to bottom: ``python notebooks/run.py [NAME ...] [--keep FOLDER]``.

They run in a folder of their own that is removed afterwards, and the notebooks here stay as they are, without outputs. ``--keep`` writes
executed copies (``.ipynb``) into a folder. ``FAUNA_NOTEBOOK_STEPS`` and ``FAUNA_NOTEBOOK_PHOTOS`` make the training shorter.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
NAMES = ("reconstruct", "explore_the_bank", "train_on_your_own_photos")


def run_notebook(path: Path, folder: Path, *, timeout: int):
    """Execute a notebook with ``folder`` as its working directory.

    Args:
        path: of the notebook.
        folder: where it works.
        timeout: of a cell, seconds.

    Returns:
        The notebook with its outputs.

    Raises:
        nbclient.exceptions.CellExecutionError: when a cell fails.
    """
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    place = {"metadata": {"path": str(folder)}}
    client = NotebookClient(notebook, timeout=timeout, startup_timeout=timeout, kernel_name="python3", resources=place)
    return client.execute()


def main() -> None:
    """Run the chosen notebooks, one after the other."""
    parser = argparse.ArgumentParser(description="Run the notebooks from top to bottom.")
    parser.add_argument("names", nargs="*", default=NAMES, metavar="NAME", help=f"of {', '.join(NAMES)} (default: all)")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="write executed copies there")
    parser.add_argument("--timeout", type=int, default=2400, help="of a cell, seconds (default: %(default)s)")
    given = parser.parse_args()
    for name in given.names:
        if name not in NAMES:
            parser.error(f"expected a name of {', '.join(NAMES)}, got {name}")
    for name in given.names:
        begun = time.monotonic()
        with tempfile.TemporaryDirectory(prefix="fauna-notebook-") as folder:
            notebook = run_notebook(HERE / f"{name}.ipynb", Path(folder), timeout=given.timeout)
        print(f"{name}: {time.monotonic() - begun:.0f} s", flush=True)
        if given.keep is not None:
            import nbformat

            given.keep.mkdir(parents=True, exist_ok=True)
            nbformat.write(notebook, given.keep / f"{name}.ipynb")


if __name__ == "__main__":
    sys.exit(main())
