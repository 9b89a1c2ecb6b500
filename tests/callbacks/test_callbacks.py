"""Callbacks on a trainer of straw."""

import logging
from pathlib import Path

import pytest
import torch
from lightning import LightningModule, Trainer

from fauna.build import build_schedule
from fauna.callbacks import preview as preview_module
from fauna.callbacks.checkpoints import Checkpoints
from fauna.callbacks.nan_guard import NanGuard
from fauna.callbacks.preview import RenderPreview
from fauna.callbacks.stages import DiscriminatorWindow, StageScheduler
from fauna.errors import FaunaError
from fauna.io.environment import environment
from fauna.system import FaunaSystem
from fauna.types import Batch
from tests.runs import composed


class Adversary:
    trainable = None

    def requires_grad_(self, value):
        self.trainable = value


class System(FaunaSystem):
    def __init__(self) -> None:
        LightningModule.__init__(self)
        self.adversary, self.stages, self.adversarial, self.last_finite = Adversary(), [], None, True
        self.model = None

    def set_stage(self, stage):
        self.stages.append(stage)


class Straw(Trainer):
    is_global_zero = True
    max_steps = 30
    global_step = strategy = datamodule = None

    def __init__(self, step: int = 0) -> None:
        self.global_step = step
        self.strategy = self
        self.datamodule = self

    def broadcast(self, value):
        return value

    def preview_photos(self, number):
        return list(range(number))

    def save_checkpoint(self, path):
        Path(path).write_text(str(self.global_step))


def micro_batch() -> Batch:
    maps = torch.zeros(2, 1, 1)
    return Batch(torch.zeros(2, 3, 1, 1), maps, maps, maps, maps, 0, ("dog/1", "dog/2"))


@pytest.fixture(scope="module")
def schedule():
    return build_schedule(composed("schedule=tiny"))


def test_stage_and_window_follow_the_step(schedule):
    system, scheduler, window = System(), StageScheduler(schedule=schedule), DiscriminatorWindow(schedule=schedule)
    opened = []
    for step in range(30):
        for callback in (scheduler, window):
            callback.on_train_batch_start(Straw(step), system, None, 0)
        assert system.adversarial is system.adversary.trainable
        opened += [step] if system.adversarial else []
    assert system.stages == [schedule.at(step) for step in range(30)]
    assert opened == list(range(12, 20))


def test_nan_guard_counts_names_and_ends(caplog):
    guard, system = NanGuard(patience=3), System()
    with caplog.at_level(logging.WARNING, logger="fauna"):
        for number, finite in enumerate([False, False, True, False, False]):
            system.last_finite = finite
            guard.on_train_batch_end(Straw(number + 1), system, None, [micro_batch()], 0)
    assert guard.state_dict() == {"total": 4, "in_a_row": 2}
    assert [record.getMessage().split(" had")[0] for record in caplog.records] == [f"step {n}" for n in (0, 1, 3, 4)]
    resumed = NanGuard(patience=3)
    resumed.load_state_dict(guard.state_dict())
    with pytest.raises(FaunaError, match=r"got 3 non-finite steps in a row \(photos: dog/1, dog/2\); look at"):
        resumed.on_train_batch_end(Straw(6), system, None, [micro_batch()], 0)


def checkpoints(folder, **changes) -> Checkpoints:
    options = {"every_steps": 4, "every_minutes": 1000.0, "keep": 2, "half": True, **changes}
    return Checkpoints(folder=str(folder), config="", **options)


def run_steps(callback, steps) -> None:
    for step in steps:
        callback.on_train_batch_end(Straw(step), System(), None, None, 0)


def test_checkpoints_come_every_few_steps_and_the_newest_are_kept(tmp_path):
    run_steps(checkpoints(tmp_path), range(1, 15))
    assert sorted(file.name for file in (tmp_path / "checkpoints").iterdir()) == [
        "step-0000008.ckpt",
        "step-0000012.ckpt",
    ]
    run_steps(checkpoints(tmp_path, every_steps=1000), [30])
    assert (tmp_path / "checkpoints" / "step-0000030.ckpt").is_file()


def test_checkpoint_also_comes_when_time_has_passed(tmp_path):
    run_steps(checkpoints(tmp_path, every_steps=1000, every_minutes=0.0), [3])
    assert [file.name for file in (tmp_path / "checkpoints").iterdir()] == ["step-0000003.ckpt"]


def test_pictures_close_every_stage(tmp_path, monkeypatch, schedule):
    monkeypatch.setattr(preview_module, "contact_sheet", lambda model, photos, cell: (len(photos), cell))
    written = []
    monkeypatch.setattr(preview_module, "save_png", lambda sheet, path: written.append((int(path.stem[5:]), sheet)))
    preview = RenderPreview(
        folder=str(tmp_path), schedule=schedule, every_steps=1000, num_photos=3, cell=16, min_steps=20
    )
    preview.on_train_start(Straw(0), System())
    run_steps(preview, range(1, 31))
    assert [step for step, _ in written] == sorted({0, 30, *(edge for edge in schedule.boundaries() if edge <= 30)})
    assert {sheet for _, sheet in written} == {(3, 16)}
    monkeypatch.setattr(Straw, "max_steps", 19)
    written.clear()
    run_steps(preview, range(1, 20))
    assert written == []


def test_environment_is_plain_text():
    assert all(type(value) is str for value in environment().values())
    assert {"torch", "numpy", "numba", "threads"} <= set(environment())
