"""A sample of the 1,000 damaged files; all of them with ``python -m tests.prepare.damaged``."""

import hashlib

from fauna.prepare.place import manifest_files
from fauna.prepare.tables import read_table
from fauna.prepare.workspace import text_of_path
from tests.prepare.damaged import COUNT, MAKERS, complaints, damaged, put, read_verdicts, run_command, verdicts

SAMPLE = range(3 * len(MAKERS))
"""Three of every maker."""


def test_files_are_the_same_every_time_and_of_every_kind():
    first, again = list(damaged(SAMPLE)), list(damaged(SAMPLE))
    assert first == again
    assert {each.kind for each in first} == set(MAKERS)
    assert len({hashlib.sha256(each.content).digest() for each in first}) > len(SAMPLE) * 0.85
    assert sorted(read_verdicts()[1]) == list(range(COUNT))


def test_each_is_used_rightly_or_skipped_for_the_reason_in_the_table(tmp_path):
    files = put(tmp_path / "pile/animal", damaged(SAMPLE))
    assert complaints(files, verdicts(files, tmp_path)) == []


def test_the_command_accounts_for_every_file_without_a_traceback(tmp_path):
    files = put(tmp_path / "pile/animal", damaged(SAMPLE))
    code, said = run_command(tmp_path)
    assert code == 0, said
    assert "Traceback" not in said
    rows = [row for file in manifest_files(tmp_path / "set") for row in read_table(file)]
    assert {row.source for row in rows} == {text_of_path(tmp_path.__class__("animal") / each.name) for each in files}
    assert all(row.reasons for row in rows if not row.ok)
