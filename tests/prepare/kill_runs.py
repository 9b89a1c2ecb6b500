"""A run that is killed again and again gives what an uninterrupted run gives, byte for byte, and repeats next to nothing.

    python tests/prepare/kill_runs.py PILE FOLDER [KEY=VALUE ...] [--kills 20] [--json FILE]

``PILE`` is prepared twice below ``FOLDER``: once in peace, once by a process that gets SIGKILL at random moments (of the steps, and while the
set is placed) and is started again. Processes are forked, so that the time goes into work instead of imports. After every kill the
visible set is examined: every photograph in it is whole.
"""

import argparse
import hashlib
import json
import os
import random
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

import fauna.prepare.check  # noqa: F401 - imported before the processes are forked
import fauna.prepare.report  # noqa: F401
from fauna.prepare import pipeline, place, runs
from fauna.prepare.settings import prepare_settings
from fauna.prepare.steps import Step
from fauna.prepare.tables import read_table
from fauna.prepare.workspace import PARTIAL


class Traced(Step):
    """A step that leaves a byte in a file before every photograph it works on."""

    def __init__(self, step: Step, trace: int) -> None:
        self.step, self.trace, self.name = step, trace, step.name

    @property
    def key(self) -> str:
        return self.step.key

    def stamp(self, rows):
        return self.step.stamp(rows)

    def outputs(self, rows):
        return self.step.outputs(rows)

    def intact(self, rows):
        return self.step.intact(rows)

    def __call__(self, rows):
        os.write(self.trace, b"s")
        return self.step(rows)


def start(source: Path, dest: Path, overrides: Sequence[str], trace: Path) -> int:
    """Fork a process that prepares a set; its number."""
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        file = os.open(trace, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        build, link = pipeline.build_step, place._link
        pipeline.build_step = lambda *given: Traced(build(*given), file)

        def traced_link(*given):
            placed = link(*given)
            if placed:
                os.write(file, b"p")
            return placed

        place._link = traced_link
        code = 0 if runs.prepare("all", source, dest, prepare_settings(overrides)) else 1
    finally:
        os._exit(code)


def kill_runs(
    source: Path, folder: Path, kills: int, overrides: Sequence[str], seed: int = 0, seconds: float = float("inf")
) -> dict | None:
    """Prepare a pile in peace and under fire; what was found, ``None`` when time was up (the same call goes on).

    Raises:
        AssertionError: when the two differ, or something half-written is visible.
    """
    begun = time.monotonic()
    peace, fire, state = folder / "peace.trace", folder / "fire.trace", folder / "state.json"
    if not state.exists():
        folder.mkdir(parents=True)
        assert os.waitpid(start(source, folder / "peace" / "set", overrides, peace), 0)[1] == 0
        state.write_text(json.dumps({"begun": 0, "killed": 0, "seconds": round(time.monotonic() - begun, 1)}))
        fire.touch()
    needed, dest = peace.read_bytes(), folder / "fire" / "set"
    rng = random.Random(seed)
    moments = sorted(rng.sample(range(1, len(needed)), kills))
    known = json.loads(state.read_text())
    for moment in moments[known["begun"] :]:
        if time.monotonic() - begun > seconds:
            return None
        known["begun"] += 1
        known["killed"] += kill_at(moment, start(source, dest, overrides, fire), fire, rng)
        state.write_text(json.dumps(known))
        look_at(dest)
    assert os.waitpid(start(source, dest, overrides, fire), 0)[1] == 0
    for part in ("set", "set.work/tables", "set.work/report"):
        expected, found = digests(folder / "peace" / part), digests(folder / "fire" / part)
        assert found == expected, sorted(set(found.items()) ^ set(expected.items()))[:5]
    done = fire.read_bytes()
    repeated = {kind: done.count(kind.encode()) - needed.count(kind.encode()) for kind in "sp"}
    return {
        "photographs": sum(1 for _ in read_table(dest / "manifest.parquet")),
        "calls": needed.count(b"s"),
        "placed": needed.count(b"p"),
        "kills": known["killed"],
        "repeated_calls": repeated["s"],
        "repeated_placements": repeated["p"],
        "repeated_share": sum(repeated.values()) / len(needed),
        "files_compared": len(digests(folder / "fire" / "set")),
        "seconds_in_peace": known["seconds"],
    }


def kill_at(moment: int, child: int, trace: Path, rng: random.Random) -> bool:
    """Kill a process when the trace has so many bytes; whether it was still at work."""
    while trace.stat().st_size < moment and os.waitpid(child, os.WNOHANG)[0] == 0:
        time.sleep(0.0005)
    time.sleep(rng.uniform(0.0, 0.003))  # anywhere within a photograph
    os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL


def look_at(dest: Path) -> None:
    """Everything visible is whole: a photograph has its mask and can be read, a manifest can be read."""
    for path in sorted(dest.rglob("*")):
        if path.name.endswith("_rgb.jpg"):
            mask = path.with_name(path.name.replace("_rgb.jpg", "_mask.png"))
            assert mask.is_file(), path
            if int(path.name[:2], 16) < 16:  # of every sixteenth the pixels, too
                for picture in (path, mask):
                    with Image.open(picture) as opened:
                        opened.load()
        elif path.name == "manifest.parquet":
            assert next(read_table(path))
        assert not path.name.endswith(PARTIAL) or path.name.startswith("."), path


def digests(folder: Path) -> dict[str, str]:
    """Digest of every file below a folder."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("pile", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument(
        "--seconds", type=float, default=float("inf"), help="stop after these; the same command goes on"
    )
    parser.add_argument("--json", type=Path)
    parser.add_argument("overrides", nargs="*")
    given = parser.parse_intermixed_args()
    found = kill_runs(given.pile, given.folder, given.kills, given.overrides, seconds=given.seconds)
    print("time is up, the same command goes on" if found is None else json.dumps(found, indent=1))
    if given.json is not None and found is not None:
        given.json.write_text(json.dumps(found, indent=1) + "\n")
    sys.exit(0)
