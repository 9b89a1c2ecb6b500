"""The CSV log of a run."""

import csv
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import Logger
from lightning.pytorch.utilities import rank_zero_only


class CsvLog(Logger):
    """Writes ``logs/metrics.csv``, one row per call; a resumed run goes on in the same file, from the step it starts at.

    Args:
        save_dir: the run's folder.
    """

    def __init__(self, *, save_dir: str) -> None:
        super().__init__()
        self.path = Path(save_dir) / "logs" / "metrics.csv"
        self._columns: list[str] | None = None

    @property
    def name(self) -> str:
        """Of the logger, for Lightning."""
        return "csv"

    @property
    def version(self) -> str:
        """Of the log, for Lightning."""
        return "logs"

    @property
    def save_dir(self) -> str:
        """The run's folder."""
        return str(self.path.parent.parent)

    def log_hyperparams(self, *args: Any, **kwargs: Any) -> None:
        """The configuration is stored by Hydra and in the checkpoints."""

    @rank_zero_only
    def log_metrics(self, metrics: dict[str, float], step: int | None = None) -> None:
        """Append one row; a new column rewrites the file."""
        row = {"step": step, **{name: float(value) for name, value in metrics.items() if name != "epoch"}}
        if self._columns is None or not row.keys() <= set(self._columns):
            earlier = self._rows(before=None if self._columns is not None else step)
            self._columns = ["step", *sorted({name for each in (row, *earlier) for name in each} - {"step"})]
            self._write([*earlier, row])
            return
        with self.path.open("a", newline="", encoding="utf-8") as handle:
            csv.DictWriter(handle, self._columns).writerow(row)

    def _rows(self, before: int | None) -> list[dict[str, Any]]:
        """What is in the file; of an earlier part of the run only the steps before the first one of this part."""
        if not self.path.is_file():
            return []
        with self.path.open(newline="", encoding="utf-8") as handle:
            rows = list(csv.DictReader(handle))
        return [row for row in rows if before is None or int(row["step"]) < before]

    def _write(self, rows: list[dict[str, Any]]) -> None:
        assert self._columns is not None
        self.path.parent.mkdir(parents=True, exist_ok=True)
        partial = self.path.with_suffix(".partial")
        with partial.open("w", newline="", encoding="utf-8") as handle:
            writer = csv.DictWriter(handle, self._columns)
            writer.writeheader()
            writer.writerows(rows)
        partial.replace(self.path)
