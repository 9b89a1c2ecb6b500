"""Arguments the benchmarks share."""

import argparse
from pathlib import Path


def new_file(text: str) -> Path:
    """A file to be written at the end; its folder is checked before anything is measured."""
    path = Path(text)
    if not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"expected a file in an existing folder, got {text}; make the folder first")
    return path


def existing_file(text: str) -> Path:
    """A file to be read."""
    path = Path(text)
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"expected a file, got {text}, which is none")
    return path
