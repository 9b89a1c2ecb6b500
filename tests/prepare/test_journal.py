"""What is committed survives any end of the program; what is torn is cut off."""

import os

import pytest

from fauna.errors import FaunaError
from fauna.prepare.journal import Journal
from tests.prepare.rows import FULL, row


def test_committed_rows_are_found_again(tmp_path):
    path = tmp_path / "a" / "j.jsonl"
    with Journal(path=path) as journal:
        assert journal.done("p", "k") is None
        journal.commit("p", "k", (FULL, row()))
        journal.commit("q", "k", (row("zebra/1.jpg"),))
        assert journal.done("p", "k") == (FULL, row())
    with Journal(path=path) as journal:
        assert journal.done("p", "k") == (FULL, row())
        assert journal.done("p", "other") is None
        assert list(journal.rows({"q", "p"})) == [FULL, row(), row("zebra/1.jpg")]


def test_later_lines_win(tmp_path):
    path = tmp_path / "j.jsonl"
    with Journal(path=path) as journal:
        journal.commit("p", "k", (row(),))
        journal.commit("p", "l", (FULL,))
    with Journal(path=path) as journal:
        assert journal.done("p", "k") is None
        assert journal.done("p", "l") == (FULL,)


def test_any_torn_end_is_cut_off_and_written_over(tmp_path):
    whole = tmp_path / "whole.jsonl"
    with Journal(path=whole) as journal:
        journal.commit("p", "k", (row(),))
        first = whole.stat().st_size
        journal.commit("q", "k", (FULL,))
    content = whole.read_bytes()
    for length in range(first, len(content)):
        path = tmp_path / "torn.jsonl"
        path.write_bytes(content[:length])
        with Journal(path=path) as journal:
            assert journal.done("p", "k") == (row(),)
            assert journal.done("q", "k") is None
            journal.commit("q", "k", (FULL,))
        assert path.read_bytes() == content


def test_one_writer_at_a_time(tmp_path):
    with Journal(path=tmp_path / "j"), pytest.raises(FaunaError, match="expected one run for a shard"):
        Journal(path=tmp_path / "j")
    Journal(path=tmp_path / "j").__exit__(None, None, None)


@pytest.mark.parametrize("half", [True, False])
def test_a_full_disk_leaves_whole_lines(tmp_path, monkeypatch, half):
    path = tmp_path / "j"
    write = os.pwrite

    def full(file, content, start):
        if half:
            return write(file, content[: len(content) // 2], start)
        raise OSError(28, "No space left on device")

    with Journal(path=path) as journal:
        journal.commit("p", "k", (row(),))
        before = path.read_bytes()
        monkeypatch.setattr(os, "pwrite", full)
        with pytest.raises(OSError, match="No space"):
            journal.commit("q", "k", (FULL,))
        assert path.read_bytes() == before
        monkeypatch.setattr(os, "pwrite", write)
        journal.commit("q", "k", (FULL,))
        assert journal.done("q", "k") == (FULL,)
