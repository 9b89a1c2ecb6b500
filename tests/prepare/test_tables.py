"""Rows survive JSON and Parquet, tables are written whole or not at all, paths of any bytes have a text."""

import os
from dataclasses import fields
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from fauna.errors import FaunaError
from fauna.prepare.reasons import NOTES, REASONS
from fauna.prepare.record import Record
from fauna.prepare.steps import IMAGE_STEPS
from fauna.prepare.tables import ROWS_AT_ONCE, read_columns, read_table, write_table
from fauna.prepare.workspace import PARTIAL, path_of_text, text_of_path, write_file
from tests.prepare.rows import FULL, row


def test_every_field_of_the_full_row_is_set():
    plain = row()
    unset = [field.name for field in fields(Record) if getattr(FULL, field.name) == getattr(plain, field.name)]
    assert set(unset) <= {"instance", "dataset", "species"}


def test_rows_survive_json_and_parquet(tmp_path):
    import json

    rows = [FULL, row("zebra/2.jpg")]
    assert [Record.from_values(json.loads(each.as_json())) for each in rows] == rows
    assert write_table(tmp_path / "a" / "t.parquet", rows) == 2
    assert list(read_table(tmp_path / "a" / "t.parquet")) == rows
    assert list(read_columns(tmp_path / "a" / "t.parquet", ["status"])) == [{"status": ["rejected", "ok"]}]


def test_tables_of_the_same_rows_have_the_same_bytes(tmp_path):
    rows = [row(f"horse/{number}.jpg") for number in range(ROWS_AT_ONCE + 10)]
    for name in ("a", "b"):
        write_table(tmp_path / name, iter(rows))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert pq.ParquetFile(tmp_path / "a").num_row_groups == 2
    assert list(read_table(tmp_path / "a")) == rows


def test_a_table_that_fails_half_way_leaves_the_old_one(tmp_path):
    path = tmp_path / "t.parquet"
    write_table(path, [FULL])
    before = path.read_bytes()

    def rows():
        yield from (row(f"horse/{number}.jpg") for number in range(2 * ROWS_AT_ONCE))
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        write_table(path, rows())
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == ["t.parquet"]


@pytest.mark.parametrize("content", [None, b"", b"PAR1 nonsense"])
def test_what_is_no_table_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "t.parquet"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(FaunaError, match=r"expects a table of fauna-prepare.*run its step again"):
        list(read_table(path))


def test_a_table_of_something_else_is_refused(tmp_path):
    import pyarrow as pa

    pq.write_table(pa.table({"id": ["a"]}), tmp_path / "t.parquet")
    with pytest.raises(FaunaError, match="expects a table of version 1, got none"):
        list(read_table(tmp_path / "t.parquet"))


@pytest.mark.parametrize(
    "name", [b"a/b.jpg", b"50%.jpg", b"%25.jpg", b"\xff\xfe/\xe9.jpg", "é/ß.jpg".encode(), b"a%FF\xff"]
)
def test_paths_of_any_bytes_have_a_text(name):
    path = Path(os.fsdecode(name))
    text = text_of_path(path)
    assert text.encode("utf-8")
    assert path_of_text(text) == path


def test_write_file_replaces_whole_and_leaves_equal_files_alone(tmp_path):
    path = tmp_path / "deep" / "a.txt"
    write_file(path, b"one")
    os.utime(path, (1, 1))
    write_file(path, b"one")
    assert path.stat().st_mtime == 1
    write_file(path, b"two")
    assert path.read_bytes() == b"two"
    assert not list(tmp_path.rglob(f"*{PARTIAL}"))


def test_write_file_leaves_nothing_behind_on_a_full_disk(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    write_file(path, b"old")

    def full(self, content):
        with self.open("wb") as file:
            file.write(content[:1])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space"):
        write_file(path, b"new")
    assert [each.name for each in tmp_path.iterdir()] == ["a.txt"]
    assert path.read_bytes() == b"old"


def test_reasons_belong_to_steps_and_overrides_set_only_some_aside():
    assert {reason.step for reason in REASONS.values()} <= {*IMAGE_STEPS, "split"}
    assert not set(REASONS) & set(NOTES)
    kept = row(override="keep")
    assert kept.rejected("filter", "blurred").ok
    assert kept.rejected("filter", "blurred").reasons == ("filter:blurred",)
    assert not kept.rejected("scan", "unreadable").ok
    assert not row().rejected("filter", "blurred", fill=0.5).ok
    assert row().rejected("filter", "blurred", fill=0.5).fill == 0.5
    assert not kept.rejected("scan", "unreadable").rejected("filter", "blurred").ok


def test_reading_needs_memory_for_a_row_group_only(tmp_path):
    write_table(tmp_path / "t", (row(f"horse/{number}.jpg") for number in range(3 * ROWS_AT_ONCE)))
    rows = read_table(tmp_path / "t")
    assert next(rows) == row("horse/0.jpg")  # and nothing forces the rest to be read
