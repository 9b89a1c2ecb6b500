"""A queue of two tiny runs, interrupted and gone on with, against its table."""

import fcntl
import json
import os
import signal
import subprocess
import sys
import time

import pytest

from fauna.queue.plan import read_plan
from fauna.queue.runner import _claimed, commands, work
from fauna.queue.summary import markdown, summarise
from tests.runs import command_environment

PLAN = """
experiment: tiny
seeds: [0]
more_seeds: {first: [1]}
rows:
  first: [trainer.max_steps=2]
  other: [trainer.max_steps=2, bank=single]
evaluations:
  zoo: [data=zoo_tiny, data.split=all, max_photos=8, size=32, pairs=10, bootstrap=20, 'baselines=[]', 'settings=[]', pictures=1]
groups: {dogs: [dog]}
metrics: [iou]
"""


@pytest.fixture(scope="module")
def queue(tmp_path_factory):
    folder = tmp_path_factory.mktemp("queue")
    (folder / "plan.yaml").write_text(PLAN)
    return folder


def start(queue):
    words = [sys.executable, "-m", "fauna.queue.command", str(queue / "plan.yaml"), f"out={queue / 'out'}"]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ)


@pytest.mark.slow
def test_interrupted_and_gone_on_with(queue):
    first = start(queue)
    assert "fauna-train" in first.stdout.readline()
    time.sleep(1.0)
    first.send_signal(signal.SIGTERM)
    _, said = first.communicate(timeout=120)
    assert first.returncode == 143, said
    assert "the same command goes on" in said
    second = start(queue)
    table, said = second.communicate(timeout=500)
    assert second.returncode == 0, said
    assert "Traceback" not in table + said
    plan = read_plan(str(queue / "plan.yaml"), [])
    assert [commands(plan, run, queue / "out") for run in plan.runs()] == [[], [], []]
    result = json.loads((queue / "out" / "table.json").read_text())
    rows = result["evaluations"]["zoo"]
    assert rows["first"]["seeds"] == [0, 1]
    own = [
        json.loads((queue / "out" / f"first-{seed}" / "evaluation" / "zoo" / "report.json").read_text())["metrics"][
            "iou"
        ]["value"]
        for seed in (0, 1)
    ]
    assert rows["first"]["values"]["iou"]["mean"] == pytest.approx(sum(own) / 2)
    assert rows["first"]["values"]["iou"]["seeds"] == pytest.approx(own)
    assert rows["first"]["differences"] == {}
    assert len(rows["other"]["differences"]["iou"]["seeds"]) == 1
    assert "| other | 0 |" in markdown(plan, summarise(plan, queue / "out"))


def test_a_run_that_somebody_works_on_is_left_alone(queue, tmp_path):
    plan = read_plan(str(queue / "plan.yaml"), [])
    said = []
    for run in plan.runs():
        (tmp_path / f".{run.name}.lock").touch()
    files = [(tmp_path / f".{run.name}.lock").open("w") for run in plan.runs()]
    for file in files:
        fcntl.flock(file, fcntl.LOCK_EX)
    assert work(plan, tmp_path, said.append) == []
    assert said == [f"{run.name}: somebody else is at it" for run in plan.runs()]
    for file in files:
        file.close()


def test_what_fails_is_named_and_the_rest_goes_on(tmp_path):
    (tmp_path / "plan.yaml").write_text(
        PLAN.replace("bank=single", "bank=nobody").replace("first: [trainer", "first: [nothing=1, trainer")
    )
    failed = work(read_plan(str(tmp_path / "plan.yaml"), []), tmp_path / "out", lambda _: None)
    assert [line.split(":")[0] for line in failed] == ["first-0", "other-0", "first-1"]
    assert all("fauna: error" in line for line in failed)


def test_the_table_before_anything_is_done(tmp_path):
    plan = read_plan("ablation", [])
    assert "none yet" in markdown(plan, summarise(plan, tmp_path))


def test_a_command_that_outlives_its_queue_keeps_the_lock(tmp_path):
    """Killed, the queue cannot end its training; a second one must not begin another in the same folder."""
    (tmp_path / "sleeper.py").write_text("import os, time; print(os.getpid(), flush=True); time.sleep(60)")
    code = (
        "from pathlib import Path; from fauna.queue import runner; from fauna.queue.plan import read_plan\n"
        "runner.commands = lambda plan, run, out: [['sleeper']]\n"
        "runner.work(read_plan('ablation', []), Path('out'), say=lambda text: None)"
    )
    queue = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, env=command_environment())
    log = tmp_path / "out" / "final-0" / "queue.log"
    until(lambda: log.is_file() and log.read_text().endswith("\n"))
    queue.kill()
    queue.wait()

    def free() -> bool:
        with _claimed(tmp_path / "out" / "final-0") as lock:
            return lock is not None

    assert not free()
    os.kill(int(log.read_text()), signal.SIGKILL)
    until(free)


def until(is_so, seconds=30.0):
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end
        time.sleep(0.02)
