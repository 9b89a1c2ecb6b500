"""Two processes of one micro-batch each equal one process that accumulates two."""

import pytest
import torch
import torch.distributed as dist

from fauna.distributed import average_gradients
from tests.runs import EVERY_STEP, command, run, same_bits, state, tiny


def test_one_process_has_nothing_to_average():
    parameter = torch.nn.Parameter(torch.ones(3))
    parameter.grad = torch.tensor([1.0, 2.0, 3.0])
    average_gradients([parameter])
    assert parameter.grad.tolist() == [1, 2, 3]


def test_gradients_add_up_and_missing_ones_count_as_zero(monkeypatch):
    both, one, none, frozen = (torch.nn.Parameter(torch.zeros(2)) for _ in range(4))
    frozen.requires_grad_(False)
    both.grad = torch.tensor([1.0, 2.0])
    other_process = [torch.tensor([1.0, 1.0, 0.0]), torch.tensor([2.0, 4.0, 5.0, 7.0])]  # who has a gradient; these
    monkeypatch.setattr(dist, "is_initialized", lambda: True)
    monkeypatch.setattr(dist, "get_world_size", lambda: 2)
    monkeypatch.setattr(dist, "all_reduce", lambda tensor: tensor.add_(other_process.pop(0)))
    average_gradients([both, frozen, one, none])
    assert both.grad.tolist() == [3, 6]
    assert one.grad.tolist() == [5, 7]
    assert none.grad is None
    assert frozen.grad is None


@pytest.mark.slow
def test_two_processes_equal_one_that_accumulates(tmp_path):
    window = (*EVERY_STEP, "trainer.max_steps=6", "schedule.adversarial=[3,5]", "schedule.articulation=[2,null]")
    done = command(*tiny(*window, "trainer.devices=2"), f"out={tmp_path}/two", seconds=300)
    assert done.returncode == 0, done.stderr[-2000:]
    run(tmp_path / "one", *tiny(*window, "data.accumulate=2"))
    two, one = state(tmp_path / "two", 6), state(tmp_path / "one", 6)
    assert two["global_step"] == one["global_step"] == 6
    assert len(list((tmp_path / "two" / "checkpoints").iterdir())) == 6
    for name, value in one["state_dict"].items():
        if torch.is_tensor(value):
            torch.testing.assert_close(two["state_dict"][name], value, rtol=1e-5, atol=1e-6, msg=name)
    moved = [not same_bits(_adversary(tmp_path, step), _adversary(tmp_path, step + 1)) for step in range(1, 6)]
    assert moved == [False, False, True, True, False]


def _adversary(folder, step: int) -> dict:
    return {
        name: value for name, value in state(folder / "two", step)["state_dict"].items() if name.startswith("adversary")
    }
