import pytest
import torch

from fauna.geometry.constants import constant, constant_index
from fauna.geometry.rows import per_row, rows_per_item


def test_rows_are_photo_major():
    values = torch.tensor([[1.0], [2.0]])
    assert per_row(values, 6)[:, 0].tolist() == [1, 1, 1, 2, 2, 2]
    assert per_row(values[:1], 3)[:, 0].tolist() == [1, 1, 1]
    assert per_row(values, 2) is values


def test_one_entry_is_not_copied():
    values = torch.rand(1, 5)
    assert per_row(values, 4).data_ptr() == values.data_ptr()


def test_gradients_of_a_photos_rows_are_added():
    values = torch.zeros(2, 1, requires_grad=True)
    (per_row(values, 4) * torch.tensor([[1.0], [2.0], [3.0], [4.0]])).sum().backward()
    assert values.grad is not None
    assert values.grad[:, 0].tolist() == [3, 7]


def test_unequal_numbers_of_rows_are_refused():
    with pytest.raises(ValueError, match="7 rows of 2 photos"):
        rows_per_item(7, 2)


def test_constants_are_made_once_and_work_under_autograd_when_first_used_for_inference():
    with torch.inference_mode():
        first = constant((1.0, 2.5), torch.zeros(1))
    assert constant((1.0, 2.5), torch.ones(3)) is first
    assert constant((1.0, 2.5), torch.zeros(1, dtype=torch.float64)).dtype == torch.float64
    assert constant_index((1, 2), torch.zeros(1)).dtype == torch.int64
    factor = torch.ones(2, requires_grad=True)
    (factor * first).sum().backward()
    assert factor.grad is not None
    assert factor.grad.tolist() == [1.0, 2.5]
