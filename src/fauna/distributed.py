"""Data-parallel training: plain gradient averaging, because one step runs several backward passes."""

from collections.abc import Iterable
from contextlib import nullcontext
from typing import Any

import torch
import torch.distributed as dist
from lightning.pytorch.overrides.distributed import _sync_module_states
from lightning.pytorch.strategies import DDPStrategy
from torch import nn


class GradientAverageStrategy(DDPStrategy):
    """Lightning's process handling without the ``DistributedDataParallel`` wrapper.

    The step averages gradients itself (:func:`average_gradients`) once all micro-batches are done, so that two processes
    of one micro-batch each equal one process that accumulates two.
    """

    def configure_ddp(self) -> None:
        """Only make every process start from the same weights."""
        assert self.model is not None
        _sync_module_states(self.model)

    def block_backward_sync(self) -> Any:
        """Nothing to block: gradients are averaged explicitly."""
        return nullcontext()


def _several_processes() -> bool:
    return dist.is_available() and dist.is_initialized() and dist.get_world_size() > 1


@torch.no_grad()
def everywhere(flag: torch.Tensor, device: torch.device) -> bool:
    """Whether a boolean scalar is true on every process, so that all of them take the same branch.

    Args:
        flag: wherever it is.
        device: on which the processes talk to each other.
    """
    if _several_processes():
        votes = flag.to(device, torch.float32)
        dist.all_reduce(votes, op=dist.ReduceOp.MIN)
        return bool(votes)
    return bool(flag)


@torch.no_grad()
def average_gradients(parameters: Iterable[nn.Parameter]) -> None:
    """Sum gradients over processes (each is already divided by the number of micro-batches of the whole step).

    A parameter without gradient on one process but with one on another counts as zero there; one that has none
    anywhere keeps none, so that optimiser states agree with a single process.
    """
    if not _several_processes():
        return
    params = [parameter for parameter in parameters if parameter.requires_grad]
    if not params:
        return
    has = torch.tensor([float(param.grad is not None) for param in params], device=params[0].device)
    dist.all_reduce(has)
    used = [param for param, count in zip(params, has.tolist(), strict=True) if count]
    if not used:
        return
    flat = torch.cat([torch.zeros_like(p).flatten() if p.grad is None else p.grad.flatten() for p in used])
    dist.all_reduce(flat)
    for param, grad in zip(used, flat.split([p.numel() for p in used]), strict=True):
        param.grad = grad.view_as(param).clone()
