"""What was done is not done again, what is missing is, and errors leave committed work alone."""

import pytest

from fauna.errors import FaunaError
from fauna.prepare.driver import run_step
from fauna.prepare.shard import Shard
from fauna.prepare.tables import read_table
from fauna.prepare.workspace import Workspace
from tests.prepare.rows import row
from tests.prepare.sets import Stamping

ONE = Shard(0, 1)


@pytest.fixture
def folders(tmp_path):
    return Workspace(tmp_path / "source", tmp_path / "set", tmp_path / "set.work")


def photos(count: int):
    return [(row(f"horse/{number}.jpg"),) for number in range(count)]


def work(step, given, folders):
    tally = run_step(step, given, folders, ONE, lambda: None)
    return tally, list(read_table(folders.table(step.name, ONE)))


def test_a_second_run_does_nothing_and_writes_the_same(folders):
    first, rows = work(Stamping(folders), photos(7), folders)
    assert (first.photos, first.worked) == (7, 7)
    table = folders.table("mask", ONE).read_bytes()
    again = Stamping(folders)
    assert work(again, photos(7)[::-1], folders)[1] == rows
    assert again.calls == []
    assert folders.table("mask", ONE).read_bytes() == table
    assert [each.id for each in rows] == sorted(each.id for each in rows)


def test_what_changed_is_done_again_and_nothing_else(folders):
    work(Stamping(folders), photos(5), folders)
    changed = [*photos(5)[:4], (row("horse/4.jpg", species="zebra"),), (row("horse/new.jpg"),)]
    step = Stamping(folders)
    _, rows = work(step, changed, folders)
    assert step.calls == ["horse/4.jpg", "horse/new.jpg"]
    assert len(rows) == 6
    other = Stamping(folders, key="l")
    work(other, changed, folders)
    assert len(other.calls) == 6


def test_photographs_that_are_gone_are_gone_from_the_table(folders):
    work(Stamping(folders), photos(5), folders)
    assert len(work(Stamping(folders), photos(3), folders)[1]) == 3


def test_a_missing_file_is_made_again(folders):
    _, rows = work(Stamping(folders), photos(5), folders)
    folders.mask(rows[2].id).unlink()
    step = Stamping(folders)
    assert work(step, photos(5), folders)[1] == rows
    assert step.calls == [rows[2].source]
    assert folders.mask(rows[2].id).is_file()


def test_an_error_leaves_what_was_committed(folders):
    with pytest.raises(OSError, match="No space"):
        work(Stamping(folders, fail_at=4), photos(7), folders)
    assert not folders.table("mask", ONE).exists()
    step = Stamping(folders)
    work(step, photos(7), folders)
    assert len(step.calls) == 7 - 3


def test_rows_that_are_out_pass_unseen(folders):
    out = (row("horse/1.jpg").rejected("scan", "unreadable"),)
    step = Stamping(folders)
    _, rows = work(step, [out], folders)
    assert step.calls == []
    assert rows == list(out)


def test_two_runs_of_a_shard_refuse_each_other(folders):
    def inner():
        with pytest.raises(FaunaError, match="expected one run for a shard"):
            work(Stamping(folders), photos(1), folders)
        yield from photos(2)

    assert len(work(Stamping(folders), inner(), folders)[1]) == 2
