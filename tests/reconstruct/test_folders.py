import json
import os
from pathlib import Path

import pytest

from fauna.errors import FaunaError
from fauna.reconstruct.folders import find_photos, finished, is_free, job_key, name_jobs, whole_folder


def touch(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(name.encode())


def test_files_folders_and_patterns(tmp_path):
    touch(
        tmp_path,
        "a/1.JPG",
        "a/2.png",
        "a/2_mask.png",
        "a/notes.txt",
        "a/.3.png",
        "a/deep/4.png",
        "a/masks/1.png",
        "b.webp",
    )
    names = lambda *inputs: [path.name for path in find_photos([str(tmp_path / each) for each in inputs])]  # noqa: E731
    assert names("a") == ["1.JPG", "2.png"]
    assert names("a/*") == ["1.JPG", "2.png"]
    assert names("a/**/*.png") == ["2.png", "4.png"]
    assert names("a/notes.txt", "b.webp", "a/2.png", "b.webp") == ["notes.txt", "b.webp", "2.png"]


@pytest.mark.parametrize("given", ["nowhere.jpg", "empty", "*.tif"])
def test_inputs_without_photographs_are_refused(tmp_path, given):
    (tmp_path / "empty").mkdir()
    with pytest.raises(FaunaError, match="expected a photograph, a folder of photographs or a pattern"):
        find_photos([str(tmp_path / given)])


def test_names_are_unique_and_do_not_collide_with_other_files():
    jobs = name_jobs([Path("a/dog.jpg"), Path("b/Dog.png"), Path("dog_2.jpg"), Path("cat.jpg")])
    assert [job.name for job in jobs] == ["dog", "Dog_3", "dog_2", "cat"]
    assert [jobs[0].animal(index) for index in range(3)] == ["dog", "dog_4", "dog_5"]
    assert [jobs[3].animal(index) for index in range(3)] == ["cat", "cat_2", "cat_3"]
    everything = [job.animal(index).casefold() for job in jobs[1:] for index in range(4)]
    assert len(set(everything)) == len(everything)


def test_keys_follow_content_masks_and_facts(tmp_path):
    touch(tmp_path, "x.jpg", "m.png")
    photo, mask = tmp_path / "x.jpg", tmp_path / "m.png"
    keys = {
        job_key(photo, [], {}), job_key(photo, [mask], {}), job_key(photo, [], {"a": 1}), job_key(photo, [], {"a": 2}),
    }  # fmt: skip
    assert len(keys) == 4
    before = job_key(photo, [mask], {})
    assert before == job_key(photo, [mask], {})
    mask.write_bytes(b"another")
    assert before != job_key(photo, [mask], {})


def put(folder, key, animals):
    folder.mkdir()
    (folder / "result.json").write_text(json.dumps({"schema": "s", "key": key, "animals": animals}))


def test_finished_means_every_animal_with_the_same_key(tmp_path):
    (job,) = name_jobs([Path("x.jpg")])
    assert finished(tmp_path, job, "k") is None
    put(tmp_path / "x", "k", ["x", "x_2"])
    assert finished(tmp_path, job, "k") is None
    put(tmp_path / "x_2", "k", ["x", "x_2"])
    assert len(finished(tmp_path, job, "k") or ()) == 2
    assert finished(tmp_path, job, "other") is None
    (tmp_path / "x_2" / "result.json").write_text("{torn")
    assert finished(tmp_path, job, "k") is None


def test_only_results_are_overwritten(tmp_path):
    (tmp_path / "empty").mkdir()
    touch(tmp_path, "mine/letter.txt", "file")
    put(tmp_path / "result", "k", [])
    for name, plain, overwriting in [
        ("none", True, True), ("empty", True, True), ("mine", False, False), ("file", False, False), ("result", False, True),
    ]:  # fmt: skip
        assert is_free(tmp_path / name, overwrite=False) == plain, name
        assert is_free(tmp_path / name, overwrite=True) == overwriting, name


def test_a_folder_appears_whole_or_not_at_all(tmp_path):
    target = tmp_path / "x"
    with whole_folder(target) as folder:
        touch(folder, "a")
        assert not target.exists()
    assert [each.name for each in target.iterdir()] == ["a"]
    with pytest.raises(ZeroDivisionError), whole_folder(target) as folder:
        touch(folder, str(1 / 0))
    assert [each.name for each in tmp_path.rglob("*")] == ["x", "a"]
    touch(tmp_path, f".x.{2**22 + 1}.partial/left-over")  # of a process that is gone
    touch(tmp_path, f".x.{os.getppid()}.partial/other")  # of one that is not
    with whole_folder(target) as folder:
        touch(folder, "c")
    assert sorted(each.name for each in tmp_path.iterdir()) == [f".x.{os.getppid()}.partial", "x"]
    assert [each.name for each in target.iterdir()] == ["c"]


def test_a_folder_is_overwritten_only_when_nothing_else_lies_in_it(tmp_path):
    touch(tmp_path, "dog/result.json")
    (tmp_path / "dog" / "result.json").write_text('{"schema": "x", "files": ["model.glb", "result.json"]}')
    touch(tmp_path, "dog/model.glb")
    assert is_free(tmp_path / "dog", overwrite=True)
    touch(tmp_path, "dog/scene.blend")
    assert not is_free(tmp_path / "dog", overwrite=True)


def test_a_result_whose_files_are_gone_is_made_again(tmp_path):
    job = name_jobs([Path("dog.jpg")])[0]
    touch(tmp_path, "dog/model.glb")
    content = {"schema": "x", "key": "k", "animals": ["dog"], "files": ["model.glb", "result.json"]}
    (tmp_path / "dog" / "result.json").write_text(json.dumps(content))
    assert finished(tmp_path, job, "k")
    (tmp_path / "dog" / "model.glb").unlink()
    assert finished(tmp_path, job, "k") is None


def test_dots_are_no_names(tmp_path):
    assert [job.name for job in name_jobs([Path("in/..jpg"), Path("in/...jpg"), Path("in/a..jpg")])] == [
        "photo",
        "photo_2",
        "a",
    ]
    with pytest.raises(FaunaError, match="cannot be replaced"), whole_folder(tmp_path / ".."):
        pass


def test_a_request_to_end_is_no_failure_of_the_photograph(monkeypatch):
    from fauna.reconstruct.batch import failed
    from fauna.reconstruct.result import Result

    monkeypatch.delenv("FAUNA_DEBUG", raising=False)
    try:
        try:
            raise SystemExit(143)
        except SystemExit as stop:
            raise SystemError("returned a result with an exception set") from stop
    except SystemError as error:
        with pytest.raises(SystemExit) as caught:
            failed(object.__new__(Result), error)
    assert caught.value.code == 143
