"""Two commands that see a whole set keep out of each other's way; shards go side by side."""

import errno
import fcntl
import subprocess
import sys

import pytest

from fauna.errors import FaunaError
from fauna.prepare import locks, place
from fauna.prepare.locks import lock, one_at_a_time, only_run
from fauna.prepare.runs import prepare
from fauna.prepare.settings import prepare_settings
from fauna.prepare.shard import Shard
from fauna.prepare.workspace import Workspace
from tests.prepare.sets import QUICK, photographs

HOLD = "import fcntl, os, sys; file = os.open(sys.argv[1], os.O_RDONLY); fcntl.flock(file, fcntl.LOCK_EX); print(); input()"


@pytest.fixture
def pile(tmp_path):
    return photographs(tmp_path / "pile" / "animals", {"horse": 3})


def run(pile, dest, *words, step="all"):
    return prepare(step, pile, dest, prepare_settings([*QUICK, "features.encoder=null", *words]))


@pytest.mark.parametrize("step", ["all", "split", "scan"])
def test_a_second_run_on_a_set_is_refused(pile, tmp_path, step):
    assert run(pile, tmp_path / "set")
    with only_run(tmp_path / "set.work", tmp_path / "set"):
        with pytest.raises(FaunaError, match=r"DEST: expected one run for .*set, got another that is at work") as error:
            run(pile, tmp_path / "set", step=step)
        assert "\n" not in str(error.value)
        with pytest.raises(FaunaError, match="DEST: expected one run"):
            run(pile, tmp_path / "set", f"work={tmp_path / 'other'}", step=step)
    assert run(pile, tmp_path / "set", step=step)


def test_shards_go_side_by_side_and_beside_nothing_else(pile, tmp_path):
    run(pile, tmp_path / "set", "shard=0/2", step="scan")
    with Workspace(pile, tmp_path / "set", tmp_path / "set.work").journal("scan", Shard(0, 2)).open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        run(pile, tmp_path / "set", "shard=1/2", step="scan")
        with pytest.raises(FaunaError, match="expected one run for a shard"):
            run(pile, tmp_path / "set", "shard=0/2", step="scan")


def test_locks_go_with_their_process(tmp_path):
    (tmp_path / "set").mkdir()
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path / "set")], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        other.stdout.readline()
        with pytest.raises(FaunaError, match="expected one run"), only_run(tmp_path, tmp_path / "set"):
            pass
        other.kill()
        other.wait()
    with only_run(tmp_path, tmp_path / "set"), one_at_a_time(tmp_path / "stage.lock"):
        pass


def test_file_systems_without_locks_are_told_once(tmp_path, monkeypatch, capsys):
    def none(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", none)
    monkeypatch.setattr(locks, "_told", False)
    with (tmp_path / "a").open("w") as file:
        assert lock(file.fileno(), wait=False)
        assert lock(file.fileno(), wait=True)
    assert capsys.readouterr().err.count("this file system has no locks") == 1


def test_placing_has_files_of_its_own(pile, tmp_path, monkeypatch):
    """Where locks are missing, two runs do not take each other's half-written files."""
    names = []
    link = place.os.link
    monkeypatch.setattr(place.os, "link", lambda source, target: (names.append(str(target)), link(source, target)))
    run(pile, tmp_path / "set")
    assert names
    assert all(f".{place.os.getpid()}." in name for name in names)
