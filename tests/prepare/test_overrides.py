"""Lists that people keep: what they change, what they may not say, and how little is done again."""

import json

import pytest

from fauna.errors import FaunaError
from fauna.prepare.overrides import Overrides, read_overrides
from fauna.prepare.runs import prepare
from fauna.prepare.settings import prepare_settings
from fauna.prepare.tables import read_table
from tests.prepare.piles import animal, put
from tests.prepare.rows import row
from tests.prepare.sets import QUICK, photographs

QUICKER = (*QUICK, "features.encoder=null")


def run(source, dest, *words):
    return prepare("all", source, dest, prepare_settings([*QUICKER, *words]))


def worked(dest):
    """Photographs that each step of the last run worked on."""
    lines = [json.loads(line) for line in (dest.with_name("set.work") / "logs/timings.jsonl").read_text().splitlines()]
    return {each["stage"]: each["worked"] for each in lines}


def rows_of(dest):
    return {row.id: row for row in read_table(dest / "manifest.parquet")}


def test_a_new_list_is_looked_up_for_the_photographs_that_it_names_only(tmp_path):
    source, dest = photographs(tmp_path / "pile", {"horse": 6}), tmp_path / "set"
    run(source, dest)
    first = sorted(rows_of(dest))[0]
    (tmp_path / "my.csv").write_text(f"# mine\n{first},drop\n")
    assert run(source, dest, f"overrides={tmp_path / 'my.csv'}")
    assert worked(dest) == {"scan": 1, "mask": 1, "crop": 1, "filter": 1}
    assert [row.id for row in rows_of(dest).values() if not row.ok] == [first]
    assert rows_of(dest)[first].reasons == ("filter:dropped",)
    assert run(source, dest)
    assert worked(dest)["scan"] == 1
    assert all(row.ok for row in rows_of(dest).values())


def test_a_list_speaks_of_each_animal_of_a_photograph(tmp_path):
    """Further animals get their rows in the mask step, after the list was first looked at."""
    put(tmp_path / "pile/horse", "two", animal(10, 30) | animal(130, 40))
    put(tmp_path / "pile/horse", "one", animal(70, 50), 1)
    dest = tmp_path / "set"
    run(tmp_path / "pile", dest)
    (photo,) = {row.photo for row in rows_of(dest).values() if row.instance == 1}
    for drop, stays in (("00", "01"), ("01", "00")):
        (tmp_path / "my.csv").write_text(f"{photo}_{drop},drop\n")
        run(tmp_path / "pile", dest, f"overrides={tmp_path / 'my.csv'}")
        assert rows_of(dest)[f"{photo}_{drop}"].reasons == ("filter:dropped",)
        assert rows_of(dest)[f"{photo}_{stays}"].ok
    (tmp_path / "my.csv").write_text(f"{photo},drop\n")
    run(tmp_path / "pile", dest, f"overrides={tmp_path / 'my.csv'}")
    assert [row.ok for row in rows_of(dest).values() if row.photo == photo] == [False, False]


@pytest.mark.parametrize("key", ["overrides", "split.back_views"])
def test_names_that_the_set_does_not_have_are_told(tmp_path, key):
    source, dest = photographs(tmp_path / "pile", {"horse": 4}), tmp_path / "set"
    verdict = ",drop" if key == "overrides" else ""
    (tmp_path / "list").write_text(f"horse/000.png{verdict}\nhorse/7.png{verdict}\n{'0' * 16}_00{verdict}\n")
    with pytest.raises(FaunaError) as error:
        run(source, dest, f"{key}={tmp_path / 'list'}")
    told = str(error.value)
    assert told.startswith(f"{key}: expected ids, photographs or sources of the set, got 2 that it does not have")
    assert f"({'0' * 16}_00, horse/7.png)" in told
    assert "\n" not in told
    (tmp_path / "list").write_text(f"horse/000.png{verdict}\n")
    assert run(source, dest, f"{key}={tmp_path / 'list'}")


@pytest.mark.parametrize("key", ["overrides", "split.back_views"])
def test_a_missing_list_is_told_before_the_work(tmp_path, key):
    source, dest = photographs(tmp_path / "pile", {"horse": 2}), tmp_path / "set"
    with pytest.raises(FaunaError, match=f"^{key}: expected .* got .*nowhere.txt"):
        prepare("scan", source, dest, prepare_settings([*QUICKER, f"{key}={tmp_path / 'nowhere.txt'}"]))
    assert not list(tmp_path.glob("set.work/**/*.parquet"))


def test_a_list_that_contradicts_itself_is_refused(tmp_path):
    (tmp_path / "list").write_text("a,keep\nb,drop\na,keep\n")
    assert read_overrides(tmp_path / "list").verdicts == {"a": "keep", "b": "drop"}
    (tmp_path / "list").write_text("a,keep\nb,drop\na,drop\n")
    with pytest.raises(FaunaError, match=r"list line 3: expected keep or drop for a, got both; remove a line$"):
        read_overrides(tmp_path / "list")


def test_what_is_said_about_a_photograph():
    one = row("horse/1.jpg")
    said = Overrides(
        {f"{one.photo}_01": "drop", "horse/1.jpg": "keep", "horse/2.jpg": "drop", f"{'0' * 16}_00": "drop"}
    )
    assert said.about(one) == f"|{one.photo}_01=drop|horse/1.jpg=keep"
    assert said.about(row("horse/3.jpg")) == ""
