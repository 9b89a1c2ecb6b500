"""Short trainings: the stored curve, resuming, who moves when, and what happens when a step goes wrong."""

import json
import logging
import math
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch

from fauna.errors import FaunaError
from fauna.io.checkpoint import newest_checkpoint
from fauna.threads import set_threads
from tests.golden.regenerate import CURVE, stage_losses
from tests.runs import (
    EVERY_STEP,
    assert_equal_bits,
    command_environment,
    dataset,
    draw_dataset,
    logged,
    reference_run,
    run,
    same_bits,
    state,
    tiny,
)

GOLDEN = Path(__file__).parent / "golden" / "tiny.json"
STOPS = (5, 12, 13, 20, 22)  # articulation opens; the adversary opens; inside it; it closes; deformation opens


@pytest.fixture(scope="module")
def reference() -> Path:
    return reference_run()


def weights_of(checkpoint: dict, prefix: str) -> dict:
    return {name: value for name, value in checkpoint["state_dict"].items() if name.startswith(prefix)}


# --- the curve -------------------------------------------------------------------------------------------------------


def test_losses_follow_the_stored_curve(reference):
    """``tests/golden/regenerate.py`` wrote the numbers; they are this code's own, so they show change, not truth."""
    stored, rows = json.loads(GOLDEN.read_text())["curve"], logged(reference)
    assert len(rows) == 30
    assert len(stored) == CURVE
    for step, (row, expected) in enumerate(zip(rows, stored, strict=False)):
        found = {name: value for name, value in row.items() if name.startswith("loss/")}
        assert found.keys() == expected.keys(), f"step {step}"
        for name, value in expected.items():
            assert found[name] == pytest.approx(value, rel=2e-2, abs=1e-6), f"{name} at step {step}"


def test_one_step_in_every_stage_gives_the_stored_losses():
    stored, found = json.loads(GOLDEN.read_text())["stages"], stage_losses()
    assert found.keys() == stored.keys()
    for step, expected in stored.items():
        assert found[step].keys() == expected.keys(), f"step {step}"
        for name, value in expected.items():
            tolerance = 2e-2 if name == "gradient_norm" else 2e-3
            assert found[step][name] == pytest.approx(value, rel=tolerance, abs=1e-6), f"{name} at step {step}"


@pytest.mark.parametrize(
    ("column", "window"),
    [
        ("loss/articulation", range(5, 30)),
        ("loss/adversarial", range(12, 20)),
        ("loss/discriminator", range(12, 20)),
        ("loss/gradient_penalty", range(12, 20)),
        ("loss/deformation", range(22, 30)),
        ("loss/mask", range(30)),
    ],
)
def test_terms_are_logged_exactly_inside_their_windows(reference, column, window):
    assert [int(row["step"]) for row in logged(reference) if column in row] == list(window)


def test_run_folder_is_complete(reference):
    result = json.loads((reference / "result.json").read_text())
    assert result["steps"] == 30
    for moment in ("untrained", "trained"):
        assert 0 < result[moment]["iou"] < 1
        assert set(result[moment]["species"]) == {"long", "round"}
    assert (reference / "weights.safetensors").is_file()
    assert not list(reference.rglob("*.partial"))
    assert [state(reference, step)["global_step"] for step in (1, 12, 13, 20, 30)] == [1, 12, 13, 20, 30]


# --- who moves when --------------------------------------------------------------------------------------------------


def test_discriminator_moves_inside_its_window_and_nowhere_else(reference):
    moved = []
    for step in range(1, 30):
        before, after = (weights_of(state(reference, at), "adversary.") for at in (step, step + 1))
        assert before
        if not same_bits(before, after):
            moved.append(step)
    assert moved == list(range(12, 20))


def test_every_part_of_the_model_learns(reference):
    first, last = (weights_of(state(reference, step), "model.") for step in (1, 30))
    parts = {".".join(name.split(".")[:2]) for name in first if not same_bits(first[name], last[name])}
    learned = {"bank", "embedder", "viewpoint", "shape", "deformation", "articulation", "appearance"}
    assert parts >= {f"model.{part}" for part in learned}
    assert "model.feature_space" not in parts
    assert not any(name.startswith("model.encoder.") for name in first)


# --- resuming --------------------------------------------------------------------------------------------------------


def test_resuming_at_every_boundary_equals_not_stopping(reference, tmp_path):
    for stop in (*STOPS, 30):
        run(tmp_path, *tiny(*EVERY_STEP, f"trainer.max_steps={stop}", "resume=auto", "schedule.lr_decay.stop=30"))
        now, expected = state(tmp_path, stop), state(reference, stop)
        for key in ("state_dict", "optimizer_states", "callbacks", "global_step"):
            assert_equal_bits(now[key], expected[key], f"{stop}/{key}")
    first, second = (logged(folder) for folder in (tmp_path, reference))
    assert first[-8:] == second[-8:]


def test_a_run_from_other_weights_resumes_with_the_same_command(reference, tmp_path):
    """Its viewpoints stay those of the other weights, to the last bit, and so does everything else."""
    start = (f"init_from={reference / 'weights.safetensors'}", "init_components=[viewpoint,mask_embedding]")
    words = (*EVERY_STEP, *start, "schedule.viewpoint_lr=0", "schedule.lr_decay.stop=30", "resume=auto")
    for stop in (4, 8):
        run(tmp_path / "stopped", *tiny(*words, f"trainer.max_steps={stop}"))
    run(tmp_path / "whole", *tiny(*words, "trainer.max_steps=8"))
    now, expected = (state(tmp_path / name, 8) for name in ("stopped", "whole"))
    for key in ("state_dict", "optimizer_states", "global_step"):
        assert_equal_bits(now[key], expected[key], key)
    for part in ("model.viewpoint.", "model.mask_embedding."):
        assert same_bits(weights_of(now, part), weights_of(state(tmp_path / "whole", 1), part))


def test_log_keeps_what_came_before_a_resume(tmp_path):
    for stop in (3, 5):
        run(tmp_path, *tiny("callbacks.checkpoints.every_steps=3", f"trainer.max_steps={stop}", "resume=auto"))
    assert [int(row["step"]) for row in logged(tmp_path)] == [0, 1, 2, 3, 4]


def test_killed_run_resumes_to_the_same_bits(reference, tmp_path):
    arguments = tiny("callbacks.checkpoints.every_steps=3", "callbacks.checkpoints.keep=2")
    process = subprocess.Popen(
        [sys.executable, "-m", "fauna.train", *arguments, f"out={tmp_path}"],
        env=command_environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    while process.poll() is None and not list(tmp_path.glob("checkpoints/*.ckpt")):
        time.sleep(0.01)
    time.sleep(random.Random().uniform(0.0, 1.0))  # any moment is a good one
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert not (tmp_path / "result.json").exists()
    run(tmp_path, *tiny("callbacks.checkpoints.every_steps=3", "resume=auto"))
    now, expected = state(tmp_path, 30), state(reference, 30)
    for key in ("state_dict", "optimizer_states", "callbacks", "global_step"):
        assert_equal_bits(now[key], expected[key], key)


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_signals_end_with_a_message_and_the_usual_code(tmp_path, sent, code):
    process = subprocess.Popen(
        [sys.executable, "-m", "fauna.train", *tiny("trainer.max_steps=3000", *EVERY_STEP), f"out={tmp_path}"],
        env=command_environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    while process.poll() is None and not list(tmp_path.glob("checkpoints/*.ckpt")):
        time.sleep(0.01)
    process.send_signal(sent)
    last = process.communicate(timeout=60)[1].strip().splitlines()[-1]
    assert process.returncode == code
    assert "interrupted at step" in last
    assert "resume=auto" in last


def test_checkpoint_with_wrong_bytes_inside_is_noticed(reference, tmp_path, caplog):
    (tmp_path / "checkpoints").mkdir()
    for step in (24, 27):
        name = f"checkpoints/step-{step:07d}.ckpt"
        shutil.copy(reference / name, tmp_path / name)
    damaged = tmp_path / "checkpoints/step-0000027.ckpt"
    content = bytearray(damaged.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 4096] = bytes(4096)
    damaged.write_bytes(content)
    with caplog.at_level(logging.WARNING, logger="fauna"):
        assert newest_checkpoint(tmp_path / "checkpoints").name == "step-0000024.ckpt"
    assert damaged.name in caplog.text


def test_checkpoint_of_another_model_is_refused(reference, tmp_path):
    other = reference / "checkpoints/step-0000024.ckpt"
    with pytest.raises(FaunaError, match="resume: expected .*bank"):
        run(tmp_path, *tiny(f'resume="{other}"', "bank.num_slots=7"))
    text = tmp_path / "notes.txt"
    text.write_text("no checkpoint")
    with pytest.raises(FaunaError, match="resume: expected a checkpoint of fauna-train"):
        run(tmp_path / "run", *tiny(f'resume="{text}"'))


def test_damaged_newest_checkpoint_falls_back_to_the_one_before(reference, tmp_path, caplog):
    (tmp_path / "checkpoints").mkdir()
    for step in (20, 24, 27):
        name = f"checkpoints/step-{step:07d}.ckpt"
        shutil.copy(reference / name, tmp_path / name)
    damaged = tmp_path / "checkpoints/step-0000027.ckpt"
    damaged.write_bytes(damaged.read_bytes()[:-2000])
    with caplog.at_level(logging.WARNING, logger="fauna"):
        run(tmp_path, *tiny("resume=auto", "trainer.max_steps=26", "schedule.lr_decay.stop=30"))
    warnings = [record.getMessage() for record in caplog.records if "damaged" in record.getMessage()]
    assert len(warnings) == 1
    assert damaged.name in warnings[0]
    assert_equal_bits(state(tmp_path, 26)["state_dict"], state(reference, 26)["state_dict"])


def test_other_threads_and_settings_are_reported(reference, tmp_path, caplog):
    (tmp_path / "checkpoints").mkdir()
    shutil.copy(reference / "checkpoints/step-0000024.ckpt", tmp_path / "checkpoints")
    try:
        with caplog.at_level(logging.WARNING, logger="fauna"):
            run(tmp_path, *tiny("resume=auto", "trainer.max_steps=25", "trainer.threads=2", "optimizer.lr=1e-5"))
    finally:
        set_threads(1)
    text = "\n".join(record.getMessage() for record in caplog.records)
    assert "threads was 1 and is now 2" in text
    assert "optimizer.lr was 0.001 and is now 1e-05" in text
    assert "max_steps" not in text


def test_second_run_in_a_folder_must_be_asked_for(reference):
    with pytest.raises(FaunaError, match=r"out: expected a new folder, got .* add resume=auto"):
        run(reference, *tiny())


@pytest.mark.parametrize("resume", ["nowhere.ckpt", "empty"])
def test_resume_needs_a_checkpoint(tmp_path, resume):
    (tmp_path / "empty").mkdir()
    with pytest.raises(FaunaError, match="resume: expected .* check the path"):
        run(tmp_path / "run", *tiny(f"resume={tmp_path / resume}"))


# --- steps that go wrong ---------------------------------------------------------------------------------------------


class Poison:
    """Turns the photos of some steps into NaN, as a broken file would."""

    def __init__(self, monkeypatch, steps) -> None:
        from fauna.data.datamodule import PhotoDataModule

        original = PhotoDataModule.step_batches

        def poisoned(module, step, sampler, rank):
            batches = original(module, step, sampler, rank)
            if step in steps:
                batches[0].images.fill_(math.nan)
            return batches

        monkeypatch.setattr(PhotoDataModule, "step_batches", poisoned)


def test_non_finite_step_is_skipped_counted_and_named(tmp_path, monkeypatch, caplog):
    Poison(monkeypatch, {3, 13})
    with caplog.at_level(logging.WARNING, logger="fauna"):
        run(tmp_path, *tiny(*EVERY_STEP, "trainer.max_steps=15", "schedule.lr_decay.stop=30"))
    for step in (3, 13):
        before, after = state(tmp_path, step), state(tmp_path, step + 1)
        assert_equal_bits(weights_of(before, "model."), weights_of(after, "model.") | _stage(before))
        assert_equal_bits(before["optimizer_states"][0]["state"], after["optimizer_states"][0]["state"])
        assert after["global_step"] == step + 1
    assert not same_bits(weights_of(state(tmp_path, 4), "model."), weights_of(state(tmp_path, 5), "model."))
    counts = next(value for key, value in state(tmp_path, 15)["callbacks"].items() if "NanGuard" in key)
    assert counts == {"total": 2, "in_a_row": 0}
    messages = [record.getMessage() for record in caplog.records if "non-finite" in record.getMessage()]
    assert [message.split(" had")[0] for message in messages] == ["step 3", "step 13"]
    assert all("blobs/" in message for message in messages)


def _stage(checkpoint: dict) -> dict:
    return {"model._extra_state": checkpoint["state_dict"]["model._extra_state"]}


def test_too_many_non_finite_steps_end_the_run(tmp_path, monkeypatch):
    Poison(monkeypatch, range(2, 30))
    with pytest.raises(
        FaunaError, match=r"3 non-finite steps in a row \(photos: blobs/.*resume from the last checkpoint"
    ):
        run(tmp_path, *tiny("callbacks.nan_guard.patience=3", "callbacks.checkpoints.every_steps=1"))


def test_poisoned_parameter_is_not_spread(tmp_path, monkeypatch):
    from fauna.system import FaunaSystem

    original = FaunaSystem.generator_losses

    def broken(system, batch, draws):
        losses, out, pair = original(system, batch, draws)
        if draws.step == 1:
            system.model.bank.values.register_hook(lambda grad: grad * math.inf)
        return losses, out, pair

    monkeypatch.setattr(FaunaSystem, "generator_losses", broken)
    with pytest.raises(FaunaError, match="2 non-finite steps in a row"):
        run(tmp_path, *tiny(*EVERY_STEP, "callbacks.nan_guard.patience=2", "trainer.max_steps=6"))
    assert all(
        value.isfinite().all() for value in weights_of(state(tmp_path, 2), "model.").values() if torch.is_tensor(value)
    )


def test_broken_photo_is_named_before_training(tmp_path):
    root = draw_dataset(tmp_path / "blobs", train=2)
    mask = next(root.glob("long/train/*_mask.png"))
    mask.write_bytes(mask.read_bytes()[:40])
    with pytest.raises(FaunaError, match=mask.name):
        run(tmp_path / "run", *tiny(f"data.root={root}", "trainer.max_steps=1"))
    result = run(tmp_path / "other", *tiny(f"data.root={root}", "trainer.max_steps=1", "data.on_bad=skip"))
    assert result["steps"] == 1


def test_dataset_of_the_tests_does_not_change():
    from PIL import Image

    colours = [
        int(torch.tensor(list(Image.open(path).tobytes())).sum()) for path in sorted(dataset().rglob("*_rgb.png"))
    ]
    assert len(colours) == 10
    assert len(set(colours)) == 10


def test_a_resumed_run_has_the_rates_it_was_given(tmp_path):
    """As the message about steps without a finite loss advises."""
    words = (*EVERY_STEP, "schedule.lr_decay.stop=30", "resume=auto")
    run(tmp_path, *tiny(*words, "trainer.max_steps=2"))
    run(tmp_path, *tiny(*words, "trainer.max_steps=3", "optimizer.lr=0", "optimizer.prior_lr=0"))
    second, third = (weights_of(state(tmp_path, step), "model.") for step in (2, 3))
    for found in (second, third):
        found.pop("model._extra_state")  # the stage has moved on
    assert same_bits(second, third)


def test_checkpoints_with_other_groups_are_refused(reference, tmp_path):
    saved = state(reference, 5)
    groups = saved["optimizer_states"][0]["param_groups"]
    groups[1]["params"] += groups.pop()["params"]
    torch.save(saved, tmp_path / "old.ckpt")
    with pytest.raises(
        FaunaError, match="^resume: expected a checkpoint whose parameters learn in the groups"
    ) as caught:
        run(tmp_path / "run", *tiny(f"resume={tmp_path / 'old.ckpt'}"))
    assert "\n" not in str(caught.value)
