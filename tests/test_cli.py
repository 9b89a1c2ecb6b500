"""The commands as a user runs them; mostly in this process, because importing everything takes seconds."""

import json
import sys
from collections import namedtuple

import pytest
from hydra.core.global_hydra import GlobalHydra

import fauna.eval
import fauna.train
from fauna.cli import run_cli
from fauna.errors import Interrupted
from tests.runs import QUIET, command, composed, dataset, tiny

SHORT = ("trainer.max_steps=2",)
Done = namedtuple("Done", "returncode stdout stderr")


@pytest.fixture
def cli(tmp_path, monkeypatch, capsys):
    """Run a command line in this process; ``out`` is ``tmp_path/run``."""

    def call(*arguments: str, main=fauna.train.main, **environment: str) -> Done:
        place = next((index for index, argument in enumerate(arguments) if "=" in argument), len(arguments))
        monkeypatch.setattr(sys, "argv", ["fauna", *arguments[:place], f"out={tmp_path}/run", *arguments[place:]])
        monkeypatch.setenv("HF_HUB_OFFLINE", "1")
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = stop.code or 0
        finally:
            GlobalHydra.instance().clear()
        return Done(code, *capsys.readouterr())

    return call


def test_bad_input_in_a_process_of_its_own(tmp_path):
    done = command("bank.num_slot=3", f"out={tmp_path}/run")
    assert done.returncode == 2
    assert done.stderr.strip().splitlines()[-1] == (
        "fauna: error: bank.num_slot: expected a known key, got an unknown one; did you mean bank.num_slots?"
    )
    assert "Traceback" not in done.stderr + done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["bank.num_slot=3"], ["bank.num_slot", "expected a known key", "did you mean bank.num_slots?"]),
        (["bank.num_slots=many"], ["bank.num_slots", "expected a whole number", "'many'", "e.g. bank.num_slots=60"]),
        (["+experiment=tiny", "bank.num_slots=0"], ["num_slots", ">= 1", "0"]),
        (["bank=giant"], ["bank", "expected one of", "semantic", "'giant'"]),
        (["+experiment=gigantic"], ["experiment", "expected one of", "quickstart", "'gigantic'"]),
        (
            ["+experiment=tiny", "data=fauna"],
            ["data.root", "expected a dataset folder", "got none", "data.root=FOLDER"],
        ),
        (
            ["+experiment=tiny", "data=fauna", "data.root=/nowhere/at/all"],
            ["data=fauna", "expects", "/nowhere/at/all", "data.root"],
        ),
        (["bank.num_slots="], ["bank.num_slots", "expected"]),
        (["+foo=3"], ["foo", "expected a known key"]),
        (["+schedule.weights.maks=3"], ["schedule.weights.maks", "mask"]),
        (["camera.fov_deg=0"], ["camera.fov_deg", "from 1 to 170", "0"]),
        (["optimizer.lr=nan"], ["optimizer.lr", "nan"]),
        (["trainer.val_every=0"], ["trainer.val_every", ">= 1", "0"]),
        (["+experiment=tiny", "trainer.devices=0"], ["trainer.devices", ">= 1", "0"]),
        (["+experiment=tiny", "trainer.devices=abc"], ["trainer"]),
        (["+experiment=tiny", "trainer.precision=bf16-mixed"], ["trainer.precision", "32-true", "bf16-mixed"]),
        (["init_components=[bank]"], ["init_components", "init_from"]),
        (["init_components=bank"], ["init_components", "'bank'"]),
        (["feature_space.whitening=-1"], ["feature_space.whitening", "0 to 1", "-1"]),
        (["schedule.viewpoint_lr=-1"], ["schedule.viewpoint_lr", ">= 0", "-1"]),
        (["schedule.viewpoint_lr=slow"], ["schedule.viewpoint_lr", ">= 0", "slow"]),
        (["feature_lookup=faces"], ["feature_lookup", "vertices, pixels", "'faces'"]),
        (["bank.num_slots"], ["bank.num_slots"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_input_ends_with_one_line_and_code_two(cli, arguments, words):
    done = cli(*arguments)
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 2, done.stderr[-500:]
    assert last.startswith("fauna: error: ")
    for word in words:
        assert word in last
    assert "Traceback" not in done.stderr + done.stdout


def test_printing_the_papers_configuration(tmp_path, cli):
    done = cli("--cfg", "job", "--resolve", "+experiment=quadruped", "data.root=DATA")
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "run").exists()
    for line in ("num_slots: 60", "top_k: 10", "batch_size: 6", "max_steps: 800000"):
        assert line in done.stdout


def test_sweep_gives_every_job_its_folder(tmp_path, cli):
    done = cli("-m", *tiny(*SHORT, "bank.num_slots=2,3"))
    assert done.returncode == 0, done.stderr[-800:]
    for job, slots in (("0", 2), ("1", 3)):
        folder = tmp_path / "run" / job
        assert json.loads((folder / "result.json").read_text())["steps"] == 2
        assert f"num_slots: {slots}" in (folder / ".hydra" / "config.yaml").read_text()


@pytest.mark.slow
def test_wandb_runs_offline_without_questions_one_per_job(tmp_path, cli):
    done = cli("-m", *tiny(*SHORT, "logger=wandb", "seed=0,1"), WANDB_MODE="online", WANDB_API_KEY="")
    assert done.returncode == 0, done.stderr[-800:]
    for job in ("0", "1"):
        assert len(list((tmp_path / "run" / job / "wandb").glob("offline-run-*"))) == 1
        assert (tmp_path / "run" / job / "logs" / "metrics.csv").is_file()


def test_missing_encoder_weights_fall_back_with_one_warning(tmp_path, cli):
    with pytest.warns(UserWarning, match="Using encoder=efficientnet_lite0 instead") as caught:
        done = cli(*tiny(*SHORT, "encoder=dino_vits8"), HF_HOME=str(tmp_path / "empty"))
    assert done.returncode == 0, done.stderr[-800:]
    assert len([warning for warning in caught if "instead" in str(warning.message)]) == 1
    stored = (tmp_path / "run" / "weights.safetensors").read_bytes()[:20000].decode(errors="ignore")
    assert "efficientnet_lite0" in stored


def test_missing_encoder_weights_without_fallback_are_an_error(tmp_path, cli):
    done = cli(*tiny(*SHORT, "encoder=dino_vits8", "encoder.offline_fallback=null"), HF_HOME=str(tmp_path / "empty"))
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 2
    assert last.startswith("fauna: error: encoder=dino_vits8 expects the weights of facebook/dino-vits8")
    assert "hf download" in last


def test_a_refused_run_leaves_nothing_and_says_one_line(tmp_path, cli):
    for arguments in (["bank.num_slots=many"], [*tiny(*SHORT), "data.root=/nowhere/at/all"]):
        done = cli(*arguments)
        assert done.returncode == 2
        assert "Error executing job" not in done.stderr
        assert not (tmp_path / "run").exists()
    done = cli("checkpoint=a", "seed=1.5", main=fauna.eval.main)
    assert done.stderr.splitlines() == ["fauna: error: seed: expected a whole number, got 1.5 (float); e.g. seed=60"]
    assert not (tmp_path / "run").exists()


def test_a_refused_run_leaves_the_files_of_others_alone(tmp_path, cli):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "notes.txt").write_text("mine")
    assert cli("bank.num_slots=many").returncode == 2
    assert (tmp_path / "run" / "notes.txt").read_text() == "mine"


def test_a_refused_job_does_not_stop_the_sweep_and_is_not_forgotten(tmp_path, cli):
    done = cli("-m", *tiny(*SHORT, "bank.num_slots=0,3,-1"))
    assert done.returncode == 2
    lines = [line for line in done.stderr.splitlines() if line.startswith("fauna: error: ")]
    assert lines[0].startswith("fauna: error: job 0 (")
    assert "bank.num_slots=0" in lines[0]
    assert lines[1].startswith("fauna: error: job 2 (")
    assert "refusals of 0, 2" in lines[2]
    assert "Error executing job" not in done.stderr
    assert json.loads((tmp_path / "run" / "1" / "result.json").read_text())["steps"] == 2
    assert "refused: " in (tmp_path / "run" / "0" / "train.log").read_text()


def test_an_interrupt_ends_the_whole_sweep(tmp_path, cli, monkeypatch):
    started = []

    def interrupted(cfg, folder):
        started.append(folder)
        raise Interrupted("training was interrupted at step 1", 130)

    monkeypatch.setattr(fauna.train, "train", interrupted)
    done = cli("-m", *tiny(*SHORT, "seed=0,1"))
    assert done.returncode == 130
    assert len(started) == 1


def test_folders_that_cannot_be_made_are_named(tmp_path, cli):
    (tmp_path / "run").write_text("a file")
    for main in (fauna.train.main, fauna.eval.main):
        done = cli("seed=0", main=main)
        assert done.returncode == 2
        assert (
            done.stderr.strip().splitlines()[-1].startswith(f"fauna: error: {tmp_path}/run: expected a path that can")
        )
        assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["chekpoint=a"], ["chekpoint: expected a known key", "did you mean checkpoint?"]),
        (["zzz=3"], ["zzz", "see fauna-eval --cfg job"]),
        (["renderer=null"], ["config group", "fauna-eval --help"]),
        (["data=nowhere"], ["data: expected one of", "zoo_small"]),
        (["checkpoint=a b=c"], ["checkpoint: expected a plain value", "put it in quotes"]),
    ],
)
def test_hints_of_eval_are_about_eval(cli, arguments, words):
    done = cli(*arguments, main=fauna.eval.main)
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 2
    for word in words:
        assert word in last
    assert "fauna-train" not in last


@pytest.mark.parametrize(
    ("word", "hint"), [("comapre", "did you mean fauna-eval compare?"), ("runs/a", "checkpoint=runs/a")]
)
def test_a_first_word_that_is_no_command(word, hint, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["fauna-eval", word, "x"])
    with pytest.raises(SystemExit, match="2"):
        fauna.eval.main()
    assert hint in capsys.readouterr().err


def test_a_reader_that_has_gone_is_no_error(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["fauna-eval", "compare"])

    def printing():
        raise BrokenPipeError(32, "Broken pipe")

    with pytest.raises(SystemExit, match="141"):
        run_cli(printing, "fauna-eval")
    assert capsys.readouterr().err == ""


def test_eval_reports_bad_weights_in_one_line(tmp_path, cli):
    (tmp_path / "other.safetensors").write_bytes(b"not a weight file")
    for name, word in (
        ("missing.safetensors", "does not exist"),
        ("other.safetensors", "damaged or of another program"),
    ):
        done = cli(f"checkpoint={tmp_path / name}", main=fauna.eval.main)
        assert done.returncode == 2
        assert word in done.stderr.strip().splitlines()[-1]
        assert "Traceback" not in done.stderr


def test_quiet_overrides_name_callbacks():
    callbacks = composed("+experiment=tiny", "data=fauna", f"data.root={dataset()}", *QUIET).callbacks
    assert callbacks.preview is None
    assert callbacks.progress is None
    assert callbacks.checkpoints is not None


def test_sweep_flag_may_stand_anywhere(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["fauna-train", "+experiment=tiny", "-m", "seed=0,1"])
    seen: list[list[str]] = []
    run_cli(lambda: seen.append(list(sys.argv)), "fauna-train")
    assert seen == [["fauna-train", "-m", "+experiment=tiny", "seed=0,1"]]
