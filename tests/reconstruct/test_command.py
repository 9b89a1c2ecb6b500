"""``fauna-reconstruct`` as a user runs it; in this process, with the model loaded once."""

import json
import sys

import numpy as np
import pytest
from PIL import Image

from tests.runs import command as process

QUICK = ("--no-finetune", "--no-texture")


@pytest.fixture
def photos(tmp_path, drawn):
    """Two photographs with masks beside them, one that is empty, and a text."""
    image, mask = drawn
    folder = tmp_path / "photos"
    folder.mkdir()
    for name, picture, marked in (("a", image, mask), ("b", image[:, ::-1], mask[:, ::-1])):
        Image.fromarray(np.ascontiguousarray(picture)).save(folder / f"{name}.png")
        Image.fromarray(marked.astype(np.uint8) * np.uint8(255)).save(folder / f"{name}_mask.png")
    (folder / "c.jpg").write_text("no picture")
    return folder


def test_help_and_bad_options_in_a_process_of_their_own():
    shown = process("--help", module="fauna.reconstruct.command", seconds=60)
    assert shown.returncode == 0
    for word in ("--mask", "--refine", "exit codes", "PHOTO"):
        assert word in shown.stdout
    bad = process("x.jpg", "--resolutio", "many", module="fauna.reconstruct.command", seconds=60)
    assert bad.returncode == 2
    assert len(bad.stderr.splitlines()) == 1
    assert bad.stderr.startswith("fauna: error: ")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.jpg"], ["nowhere.jpg", "expected a photograph", "check the path"]),
        (["photos", "--format", "fbx"], ["format", "glb, obj, ply", "'fbx'"]),
        (["photos", "--format", ""], ["format", "glb, obj, ply"]),
        (["photos", "--resolution", "7"], ["resolution", "8 to 256", "7"]),
        (["photos", "--texture-size", "-1"], ["texture-size", "0 to 8192"]),
        (["photos", "--refine", "-3"], ["refine", "-3"]),
        (["photos", "--mask", "photos/a_mask.png"], ["--mask", "one photograph", "3"]),
        (["photos/a.png", "--mask", "nowhere.png"], ["--mask", "nowhere.png"]),
        (["photos", "--checkpoint", "nowhere.ckpt"], ["checkpoint", "nowhere.ckpt"]),
        (["photos", "--threads", "0"], ["--threads", ">= 1"]),
        (["photos", "-o", "photos/a.png"], ["--out", "a file"]),
        (["photos", "--refine", "x"], ["--refine", "'x'", "--help"]),
        ([], ["PHOTO", "--help"]),
    ],
    ids=lambda value: " ".join(value),
)
def test_bad_arguments_end_with_one_line_and_code_two(call, photos, arguments, words):
    code, _, said, _ = call(*arguments)
    assert code == 2
    assert len(said.splitlines()) == 1
    assert said.startswith("fauna: error: ")
    for word in words:
        assert word in said


def test_a_folder_is_done_once_and_again_only_when_something_changed(call, photos, tmp_path):
    code, said, _, loads = call("photos", *QUICK)
    assert code == 1
    assert [json.loads((tmp_path / "out" / name / "result.json").read_text())["status"] for name in "abc"] == [
        "ok", "ok", "unreadable",
    ]  # fmt: skip
    for line in ("a: ok", "b: ok", "c: unreadable", "3 animals: 2 ok, 1 unreadable"):
        assert line in said
    assert not list((tmp_path / "out").glob(".*"))
    count = len(loads)
    stamp = (tmp_path / "out/a/model.glb").stat().st_mtime_ns
    code, said, _, loads = call("photos", *QUICK)
    assert (code, len(loads)) == (1, count)
    assert said.count("done before") == 3
    assert (tmp_path / "out/a/model.glb").stat().st_mtime_ns == stamp

    code, said, _, _ = call("photos/a.png", *QUICK, "--no-viewer")
    assert code == 1
    assert "a: exists" in said
    assert (tmp_path / "out/a/viewer.html").is_file()
    code, *_ = call("photos/a.png", *QUICK, "--no-viewer", "--overwrite")
    assert code == 0
    assert not (tmp_path / "out/a/viewer.html").exists()


def test_foreign_folders_are_never_touched(call, photos, tmp_path):
    (tmp_path / "out/a").mkdir(parents=True)
    (tmp_path / "out/a/letter.txt").write_text("mine")
    code, said, _, _ = call("photos/a.png", *QUICK, "--overwrite")
    assert (code, "a: exists" in said) == (1, True)
    assert [each.name for each in (tmp_path / "out/a").iterdir()] == ["letter.txt"]


def test_several_animals_get_folders_of_their_own_and_vanish_with_them(call, photos, tmp_path, drawn):
    mask = np.zeros(drawn[1].shape, np.uint8)
    mask[40:120, 20:100] = mask[140:220, 140:230] = 255
    Image.fromarray(mask).save(tmp_path / "two.png")
    call("photos/a.png", *QUICK, "--mask", "two.png")
    assert sorted(each.name for each in (tmp_path / "out").iterdir()) == ["a", "a_2"]
    one = tmp_path / "photos/a_mask.png"
    code, *_ = call("photos/a.png", *QUICK, "--mask", one, "--overwrite")
    assert code == 0
    assert sorted(each.name for each in (tmp_path / "out").iterdir()) == ["a"]


def test_a_defect_costs_one_photograph(call, photos, tmp_path, monkeypatch):
    def broken(*given, **named):
        raise RuntimeError("two\nlines")

    monkeypatch.setattr(sys.modules["fauna.export"], "rig_reconstruction", broken)
    code, said, _, _ = call("photos/a.png", "photos/c.jpg", *QUICK)
    content = json.loads((tmp_path / "out/a/result.json").read_text())
    assert code == 1
    assert (content["status"], content["animal"]) == ("failed", None)
    assert content["reason"].startswith("RuntimeError: two lines")
    assert "c: unreadable" in said


def test_an_interrupt_leaves_nothing_half_written(call, photos, tmp_path, monkeypatch):
    def interrupted(animal, path):
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["fauna.export"], "write_glb", interrupted)
    code, _, said, _ = call("photos", *QUICK)
    assert code == 130
    assert "the same command goes on" in said
    assert list((tmp_path / "out").iterdir()) == []


def test_a_request_to_terminate_ends_with_143(call, photos, tmp_path, monkeypatch):
    import os
    import signal

    def terminated(animal, path):
        path.write_bytes(b"half")
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(sys.modules["fauna.export"], "write_glb", terminated)
    before = signal.getsignal(signal.SIGTERM)
    try:
        code, *_ = call("photos", *QUICK)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert code == 143
    assert list((tmp_path / "out").iterdir()) == []
