"""What reports of ``fauna-eval`` say about the weights that are published."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fauna.errors import FaunaError

Report = Mapping[str, Any]
"""Content of a ``report.json``."""


def read_report(folder: Path, digest: str) -> Report:
    """A report of exactly these weights.

    Args:
        folder: that holds ``report.json``, or the file itself.
        digest: SHA-256 of the weight file.

    Raises:
        FaunaError: when it is no report, or one of other weights.
    """
    path = folder / "report.json" if folder.is_dir() else folder
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
        of = report["protocol"]["checkpoint"]["sha256"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FaunaError(
            f"report: expected a folder with the report.json of fauna-eval, got {folder} ({type(error).__name__}); "
            "check the path"
        ) from error
    if of != digest:
        raise FaunaError(
            f"report: expected one of the weights with SHA-256 {digest[:16]}, got {folder} of {of[:16]}; "
            "evaluate the file that is published"
        )
    return report


def head_is_at_minus_z(reports: Sequence[Report]) -> bool:
    """Whether the model that was measured has its head at -z (``global_flip``).

    Args:
        reports: those of datasets without truth cannot tell.

    Raises:
        FaunaError: when none can, or they disagree.
    """
    rows = [report["metrics"].get("global_flip") for report in reports]
    found = {bool(row["value"]) for row in rows if row and row["n"]}
    if len(found) != 1:
        got = "reports that disagree" if found else "none of a dataset with truth"
        raise FaunaError(
            f"report: expected one that tells at which end of the z axis the head is, got {got}; evaluate on data=zoo"
        )
    return found.pop()
