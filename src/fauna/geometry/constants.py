"""Small constant tensors, made once per precision and device.

A tensor made from Python numbers in every call costs a copy, on a GPU also a wait for the device.
"""

from functools import lru_cache
from typing import Any

import torch
from torch import Tensor

Numbers = tuple[Any, ...]
"""Nested tuples of numbers."""


@lru_cache(maxsize=256)
def _make(numbers: Numbers, dtype: torch.dtype, device: torch.device) -> Tensor:
    with torch.inference_mode(False):  # else the first caller's mode would stick to the tensor
        return torch.tensor(numbers, dtype=dtype, device=device)


def constant(numbers: Numbers, like: Tensor) -> Tensor:
    """A shared tensor of the precision and on the device of another; not to be written to.

    Args:
        numbers: nested tuples, as ``torch.tensor`` takes them.
        like: gives precision and device.
    """
    return _make(numbers, like.dtype, like.device)


def constant_index(numbers: Numbers, like: Tensor) -> Tensor:
    """A shared int64 tensor on the device of another; not to be written to."""
    return _make(numbers, torch.int64, like.device)
