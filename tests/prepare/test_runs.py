"""Whole runs: the same set whatever the number of shards, second runs change nothing, faults end in one line."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fauna.data.fauna_folder import read_fauna_folder
from fauna.errors import FaunaError
from fauna.prepare import pipeline
from fauna.prepare.check import audit_set
from fauna.prepare.runs import prepare
from fauna.prepare.settings import prepare_settings
from fauna.prepare.steps import IMAGE_STEPS
from fauna.prepare.tables import read_table
from fauna.prepare.workspace import Workspace
from tests.prepare.kill_runs import digests, kill_runs
from tests.prepare.sets import QUICK, photographs

STEPS = list(IMAGE_STEPS)


def run(source: Path, dest: Path, *overrides: str, step: str = "all") -> bool:
    return prepare(step, source, dest, prepare_settings([*QUICK, *overrides]))


@pytest.fixture(scope="module")
def pile(tmp_path_factory):
    return photographs(tmp_path_factory.mktemp("pile") / "animals", {"horse": 9, "zebra": 5})


@pytest.fixture(scope="module")
def whole(pile, tmp_path_factory):
    dest = tmp_path_factory.mktemp("whole") / "set"
    assert run(pile, dest)
    return dest


def test_the_set_is_a_data_root(whole):
    found = read_fauna_folder(whole, photograph_pattern=r"(.+_\d+)_\d+")
    assert {name: (len(each.train), len(each.val)) for name, each in found.items()} == {
        "horse": (7, 2),
        "zebra": (3, 2),
    }
    assert all(photo.source.read().image.shape == (32, 32, 3) for photo in found["horse"].train)


def test_the_manifest_is_sorted_and_says_everything(whole):
    rows = list(read_table(whole / "manifest.parquet"))
    assert [row.id for row in rows] == sorted(row.id for row in rows)
    assert len(rows) == 14
    assert all(row.ok and row.sha256 and row.rgb_sha256 and row.split and row.window for row in rows)


def test_a_second_run_changes_no_byte_and_no_time(pile, whole):
    def looks():
        return {path: (path.stat().st_mtime_ns, path.stat().st_ino) for path in (whole, *whole.rglob("*"))}

    before = looks()
    assert run(pile, whole)
    assert looks() == before


@pytest.mark.parametrize("end", ["rgb.jpg", "mask.png", "box.txt", "feat16.png"])
def test_what_is_written_over_in_the_set_is_made_again(pile, whole, tmp_path, end):
    """Files of the set are links to those of the work folder: damage is in both."""
    dest = tmp_path / "set"
    run(pile, dest)
    path = sorted(dest.rglob(f"*_{end}"))[0]
    with path.open("r+b") as file:
        file.write(b"damage")
    if end != "box.txt":
        with pytest.raises(FaunaError, match="expected the file that was made, got other bytes"):
            run(pile, dest, step="split")
    assert run(pile, dest)
    assert digests(dest) == digests(whole)


def test_without_the_work_folder_the_same_set_comes_out(pile, whole, tmp_path):
    dest = tmp_path / "set"
    shutil.copytree(whole, dest)
    before = {path: path.stat().st_mtime_ns for path in dest.rglob("*") if path.is_file()}
    assert run(pile, dest)
    assert {path: path.stat().st_mtime_ns for path in dest.rglob("*") if path.is_file()} == before


def test_shards_in_any_order_give_the_same_set(pile, whole, tmp_path, monkeypatch):
    monkeypatch.setattr(pipeline, "MOST_OPEN", 2)  # three tables are merged in two rounds
    dest = tmp_path / "set"
    for step in STEPS:
        for index in (2, 0, 1):
            run(pile, dest, f"shard={index}/3", step=step)
    run(pile, dest, step="split")
    assert digests(dest) == digests(whole)
    with pytest.raises(FaunaError, match="expected one of 3 shards"):
        run(pile, dest, "shard=0/2", step="scan")


def test_steps_that_are_missing_are_named(pile, tmp_path):
    run(pile, tmp_path / "set", "shard=0/2", step="scan")
    with pytest.raises(FaunaError, match=r"expected the tables of fauna-prepare scan, got none of 00001-of-00002"):
        run(pile, tmp_path / "set", "shard=0/2", step="mask")
    with pytest.raises(FaunaError, match="shard: expected none for fauna-prepare all"):
        run(pile, tmp_path / "set", "shard=0/2")


def test_ray_gives_the_same_set(pile, whole, tmp_path):
    ray = pytest.importorskip("ray")
    try:
        assert run(pile, tmp_path / "set", "runner=ray", "shards=3")
    finally:
        ray.shutdown()
    assert digests(tmp_path / "set") == digests(whole)


def test_photographs_that_go_take_their_crops_along(pile, tmp_path):
    source = shutil.copytree(pile, tmp_path / "pile" / "animals")
    dest = tmp_path / "set"
    run(source, dest)
    for path in (source / "horse").glob("00[0-2]*"):
        path.unlink()
    assert run(source, dest)
    assert len(list(dest.rglob("*_rgb.jpg"))) == 11
    assert audit_set(dest, prepare_settings(QUICK)).sound


def test_other_splits_move_files(pile, tmp_path):
    dest = tmp_path / "set"
    run(pile, dest)
    (dest / "note.txt").write_text("mine")
    assert run(pile, dest, "split.held_out=[zebra]", step="split")
    assert not (dest / "zebra" / "train").exists()
    assert len(list((dest / "zebra" / "test").glob("*_rgb.jpg"))) == 5
    assert (dest / "note.txt").read_text() == "mine"


def test_killed_runs(tmp_path):
    """The small form of what docs/prepare.md reports of 5,000 pictures."""
    source = photographs(tmp_path / "pile" / "animals", {"horse": 12, "zebra": 4})
    code = f"from tests.prepare.kill_runs import kill_runs; from pathlib import Path; print(kill_runs(Path({str(source)!r}), Path({str(tmp_path / 'runs')!r}), 6, {list(QUICK)!r}))"
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=root,
        env=os.environ | {"PYTHONPATH": f"{root / 'src'}"},
        capture_output=True,
        text=True,
        check=False,
    )  # a process of its own: it forks
    assert done.returncode == 0, done.stderr
    found = eval(done.stdout.splitlines()[-1])
    assert found["kills"] == 6
    assert found["files_compared"] == 16 * 4 + 1
    assert 0 <= found["repeated_calls"] <= 6


def test_check_finds_what_is_wrong(whole, tmp_path):
    def faults(change) -> set[str]:
        dest = tmp_path / change.__name__
        shutil.copytree(whole, dest)
        change(dest)
        return {
            name
            for name, found in audit_set(dest, prepare_settings(QUICK)).findings.items()
            if found.faults and found.fatal
        }

    def first(dest, end):
        return sorted(dest.rglob(f"*_{end}"))[0]

    def nothing(dest):
        pass

    def gone(dest):
        first(dest, "mask.png").unlink()

    def cut_short(dest):
        path = first(dest, "rgb.jpg")
        path.write_bytes(path.read_bytes()[:100])

    def stray(dest):
        shutil.copy(first(dest, "rgb.jpg"), dest / "horse" / "train" / "mine_rgb.jpg")

    def leak(dest):
        from dataclasses import replace

        from fauna.prepare.tables import write_table

        rows = list(read_table(dest / "manifest.parquet"))
        val = next(row for row in rows if row.split == "val")
        write_table(
            dest / "manifest.parquet",
            [
                replace(row, sha256=val.sha256, phash=val.phash, cluster=val.cluster) if row.split == "train" else row
                for row in rows
            ],
        )

    assert faults(nothing) == set()
    assert faults(gone) == {"files"}
    assert faults(cut_short) == {"files", "rgb"}
    assert faults(stray) == {"no strays"}
    assert {"one split each", "no duplicates", "no near duplicates"} <= faults(leak)
    strict = audit_set(whole, prepare_settings([*QUICK, "check.unlicensed=fail"]))
    assert not strict.sound
    with pytest.raises(FaunaError, match="expected a set of fauna-prepare"):
        audit_set(tmp_path, prepare_settings(QUICK))


def test_folders_that_cannot_be_used_are_refused(pile, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter.txt").write_text("dear")
    (tmp_path / "file").write_text("")
    for dest, words in (
        (tmp_path / "full", "expected a new folder or a set"),
        (tmp_path / "file", "which is a file"),
        (pile / "set", "outside of SOURCE"),
        (pile.parent, "SOURCE does not lie in"),
    ):
        with pytest.raises(FaunaError, match=words):
            run(pile, dest)
    with pytest.raises(FaunaError, match="which does not exist"):
        run(tmp_path / "nothing", tmp_path / "set")
    with pytest.raises(FaunaError, match=r"DEST: expected a folder whose name is UTF-8 text, got .*odd.udcff;"):
        run(pile, tmp_path / os.fsdecode(b"odd\xff"))
    with pytest.raises(FaunaError, match="the set and the way to it"):
        run(pile, tmp_path / "set", f"work={tmp_path / 'set' / 'work'}")


def test_when_nothing_can_be_used_it_is_said_why(tmp_path):
    (tmp_path / "pile" / "horse").mkdir(parents=True)
    for name in "ab":
        (tmp_path / "pile" / "horse" / f"{name}.jpg").write_bytes(b"no picture")
    with pytest.raises(FaunaError, match=r"got none \(unreadable 2\)"):
        run(tmp_path / "pile", tmp_path / "set")


def test_a_full_disk_ends_in_one_line_and_the_run_goes_on(pile, whole, tmp_path, monkeypatch):
    left = [9]

    def failing(self, content, write=Path.write_bytes):
        left[0] -= 1
        if left[0] < 0:
            raise OSError(28, "No space left on device", str(self))
        return write(self, content)

    dest = tmp_path / "set"
    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_bytes", failing)
        with pytest.raises(OSError, match="No space left"):
            run(pile, dest)
    assert run(pile, dest)
    assert digests(dest) == digests(whole)


def test_commands_end_as_documented(pile, whole, tmp_path):
    root = Path(__file__).parents[2]

    def call(*words: str):
        return subprocess.run(
            [sys.executable, "-m", "fauna.prepare.command", *words],
            cwd=root,
            env=os.environ | {"PYTHONPATH": str(root / "src")},
            capture_output=True,
            text=True,
            check=False,
        )

    helped = call("--help")
    assert helped.returncode == 0
    assert "exit codes" in helped.stdout
    for words, told in (
        (("all", str(pile)), "DEST"),
        (("bake", "a", "b"), "invalid choice"),
        (("all", str(pile), str(tmp_path / "x"), "crop.sizes=3"), "crop.sizes: expected a key of conf/prepare.yaml"),
        (
            ("all", str(pile), str(tmp_path / "x"), "crop.size=big"),
            "crop.size: expected a whole number from 32 to 2,048",
        ),
        (("check", str(tmp_path)), "expected a set of fauna-prepare"),
    ):
        ended = call(*words)
        assert ended.returncode == 2
        assert told in ended.stderr
        assert ended.stderr.count("\n") == 1
    assert call("check", str(whole)).returncode == 0  # whatever size its crops have
    shutil.copytree(whole, tmp_path / "copy")
    sorted((tmp_path / "copy").rglob("*_mask.png"))[0].unlink()
    assert call("check", str(tmp_path / "copy")).returncode == 1


def test_names_that_are_no_utf8_are_prepared(tmp_path):
    odd = tmp_path / "pile" / os.fsdecode(b"two\nlines \xff")
    photographs(tmp_path / "pile" / "animals", {"horse": 3})
    folder = os.fsencode(tmp_path / "pile" / "animals" / "horse")
    try:
        for end in (b".png", b"_mask.png"):
            os.rename(folder + b"/001" + end, folder + b"/\xff1" + end)
    except OSError:
        pytest.skip("this file system has no such names")
    (tmp_path / "pile" / "animals").rename(odd)
    assert run(odd, tmp_path / "set")
    assert run(odd, tmp_path / "set")
    rows = list(read_table(tmp_path / "set" / "manifest.parquet"))
    assert "horse/%FF1.png" in {row.source for row in rows}
    assert all(row.ok for row in rows)


def test_the_workspace_is_plain_data():
    import pickle

    workspace = Workspace(Path("a"), Path("b"), Path("c"))
    assert pickle.loads(pickle.dumps(workspace)) == workspace
    assert kill_runs


def test_odd_names_are_one_line_in_the_table_of_an_audit(pile, tmp_path, capsys, monkeypatch):
    from fauna.prepare.check import check_set

    monkeypatch.setenv("COLUMNS", "200")
    dest = tmp_path / "set"
    run(pile, dest, "features.encoder=null")
    odd = dest / "horse" / "train" / "[red]two\x1blines_rgb.jpg"
    odd.write_bytes(sorted(dest.rglob("*_rgb.jpg"))[0].read_bytes())
    capsys.readouterr()
    assert not check_set(dest, prepare_settings(QUICK))
    assert r"[red]two\x1blines is not in the manifest" in capsys.readouterr().out
