"""Works through a plan: every run is trained and evaluated by the project's own commands, in processes of their own."""

import fcntl
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fauna.queue.plan import Plan, Run

REPORT = "report.json"
POLL_SECONDS = 0.2


class Interrupted(Exception):
    """The queue was asked to end; carries the signal's number."""


def report_folder(out: Path, run: Run, evaluation: str) -> Path:
    """Where an evaluation of a run lies."""
    return out / run.name / "evaluation" / evaluation


def commands(plan: Plan, run: Run, out: Path) -> list[list[str]]:
    """What is left to do for a run, as words after ``python -m``; empty when it is done.

    A training is done when its folder holds ``result.json``, which is written last; one that is not goes on from its newest
    checkpoint. An evaluation is done when it has a report.
    """
    folder = out / run.name
    left = []
    if not (folder / "result.json").is_file():
        words = [f"+experiment={plan.experiment}", f"seed={run.seed}", *run.overrides, f"out={folder}", "resume=auto"]
        left.append(["fauna.train", *words])
    for name, words in plan.evaluations.items():
        target = report_folder(out, run, name)
        if not (target / REPORT).is_file():
            left.append(["fauna.eval", f"checkpoint={folder}", *words, f"out={target}"])
    return left


def work(plan: Plan, out: Path, say: Callable[[str], None]) -> list[str]:
    """Do everything that nobody else is doing.

    Several processes may work on one folder: a run is locked while it is worked on, and a lock ends with the queue and the command at
    work, however these end. What a command prints goes to ``queue.log`` in the run's folder. A command that fails ends its run, not the queue.

    Args:
        plan: of the queue.
        out: its folder.
        say: told what happens.

    Returns:
        Names of the runs that failed, with the last line of what they said.

    Raises:
        Interrupted: after a signal; the command at work was told, and has ended.
    """
    failed = []
    for run in plan.runs():
        with _claimed(out / run.name) as lock:
            if lock is None:
                say(f"{run.name}: somebody else is at it")
                continue
            for words in commands(plan, run, out):
                say(f"{run.name}: {words[0].replace('.', '-')} {' '.join(words[1:])}")
                started = time.monotonic()
                code, last = _execute(words, out / run.name / "queue.log", lock)
                if code:
                    failed.append(f"{run.name}: {last}")
                    say(f"{run.name}: exit code {code}: {last}")
                    break
                say(f"{run.name}: {time.monotonic() - started:.0f} s")
    return failed


@contextmanager
def _claimed(folder: Path) -> Iterator[int | None]:
    """The lock's file descriptor, ``None`` when somebody else has it."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with (folder.parent / f".{folder.name}.lock").open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield None
        else:
            yield file.fileno()


def _execute(words: list[str], log: Path, lock: int) -> tuple[int, str]:
    """Run one command; a signal is passed on to it, and raised when it has ended.

    It holds the lock too: should the queue be killed, the command goes on alone, and nobody else may begin.
    """
    log.parent.mkdir(parents=True, exist_ok=True)
    received: list[int] = []
    with log.open("ab") as file:
        start = file.tell()
        process = subprocess.Popen(
            [sys.executable, "-m", *words],
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            preexec_fn=os.setpgrp,  # a Ctrl-C reaches it once, through us
            pass_fds=(lock,),
        )

        def pass_on(number: int, _: object) -> None:
            received.append(number)
            os.kill(process.pid, number)

        before = {number: signal.signal(number, pass_on) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            while process.poll() is None:
                time.sleep(POLL_SECONDS)
        finally:
            for number, handler in before.items():
                signal.signal(number, handler if handler is not None else signal.SIG_DFL)
    if received:
        raise Interrupted(received[0])
    said = log.read_bytes()[start:].decode("utf-8", "replace").replace("\r", "\n").strip().splitlines()
    return process.returncode, said[-1] if said else "said nothing"
