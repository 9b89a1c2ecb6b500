"""Rows as Parquet: one schema for every stage and for the manifest, written whole or not at all, the same bytes for the same rows."""

import contextlib
import os
from collections.abc import Iterable, Iterator
from dataclasses import fields
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from fauna.errors import FaunaError
from fauna.prepare.record import Record
from fauna.prepare.workspace import PARTIAL

SCHEMA_VERSION = "1"
ROWS_AT_ONCE = 4096
"""Rows in a row group: what reading and writing hold in memory."""

_TEXT, _FLAG = pa.string(), pa.list_(pa.string())
_SPECIAL = {
    "instance": pa.int32(),
    "frame": pa.int64(),
    "annotated_size": pa.list_(pa.int32()),
    "box": pa.list_(pa.float64()),
    "keypoints": pa.list_(pa.list_(pa.float64())),
    "width": pa.int32(),
    "height": pa.int32(),
    "orientation": pa.int32(),
    "window": pa.list_(pa.float64()),
    "sharpness": pa.float64(),
    "fill": pa.float64(),
    "truncation": pa.float64(),
    "occlusion": pa.float64(),
    "parts": pa.int32(),
    "reasons": _FLAG,
    "notes": _FLAG,
}
SCHEMA = pa.schema(
    [pa.field(field.name, _SPECIAL.get(field.name, _TEXT)) for field in fields(Record)],
    metadata={"fauna.manifest": SCHEMA_VERSION},
)


def write_table(path: Path, rows: Iterable[Record]) -> int:
    """Write rows in their order; memory is that of one row group. The caller holds a lock: what killed writers left is removed.

    Args:
        path: Parquet file, replaced at once when all rows are written.
        rows: in the order of their ids.

    Returns:
        How many rows.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    for left in path.parent.glob(f".{path.name}.*{PARTIAL}"):
        left.unlink(missing_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}{PARTIAL}")
    number = 0
    try:
        with pq.ParquetWriter(partial, SCHEMA, compression="zstd") as writer:
            for batch in _batches(rows):
                number += batch.num_rows
                writer.write_batch(batch, row_group_size=ROWS_AT_ONCE)
        with partial.open("rb+") as file:
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        with contextlib.suppress(OSError):
            partial.unlink()
    return number


def read_table(path: Path, at_once: int = ROWS_AT_ONCE) -> Iterator[Record]:
    """Rows of a table in their order, a few at a time.

    Args:
        path: Parquet file.
        at_once: rows that are held as plain values; fewer where many tables are read side by side.

    Raises:
        FaunaError: when it is missing, damaged, or of another version.
    """
    with _opened(path) as file:
        for batch in file.iter_batches(batch_size=at_once):
            for values in batch.to_pylist():
                yield Record.from_values(values)


def read_columns(path: Path, columns: list[str]) -> Iterator[dict[str, list]]:
    """Columns of a table as plain lists, a row group at a time: quicker than rows where few are needed."""
    with _opened(path) as file:
        for batch in file.iter_batches(batch_size=ROWS_AT_ONCE, columns=columns):
            yield batch.to_pydict()


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[pq.ParquetFile]:
    try:
        file = pq.ParquetFile(path)
    except (OSError, pa.ArrowInvalid) as error:
        reason = " ".join(str(error).split())[:120]
        raise FaunaError(f"{path} expects a table of fauna-prepare, got {reason}; run its step again") from error
    with file:
        found = (file.schema_arrow.metadata or {}).get(b"fauna.manifest", b"none").decode()
        if found != SCHEMA_VERSION:
            raise FaunaError(f"{path} expects a table of version {SCHEMA_VERSION}, got {found}; prepare the set again")
        yield file


def _batches(rows: Iterable[Record]) -> Iterator[pa.RecordBatch]:
    held: list[dict] = []
    for row in rows:
        held.append({name: getattr(row, name) for name in SCHEMA.names})
        if len(held) == ROWS_AT_ONCE:
            yield pa.RecordBatch.from_pylist(held, schema=SCHEMA)
            held = []
    if held:
        yield pa.RecordBatch.from_pylist(held, schema=SCHEMA)
