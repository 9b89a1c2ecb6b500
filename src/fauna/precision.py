"""Where matrix products of learned fields may run in bfloat16. Geometry, cameras and losses are always float32."""

from contextlib import AbstractContextManager
from typing import Literal

import torch

Precision = Literal["float32", "bfloat16", "auto"]
"""``auto`` is bfloat16 where the hardware multiplies it natively, float32 elsewhere."""


CPU_FLAGS = {"avx2": "avx2", "avx512f": "avx512_f", "avx512_bf16": "avx512_bf16", "amx_bf16": "amx_bf16"}
"""Instruction sets that decide how fast convolutions and matrix products are: usual name -> torch's name."""


def matmul_precision(precision: Precision, device: torch.device) -> AbstractContextManager:
    """Context in which linear layers and convolutions on ``device`` run in a precision; sums stay float32."""
    reduced = precision == "bfloat16" or (precision == "auto" and native_bfloat16(device))
    return torch.autocast(device.type, dtype=torch.bfloat16, enabled=reduced)


def native_bfloat16(device: torch.device) -> bool:
    """Whether bfloat16 matrix products gain anything on a device."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    return device.type == "cpu" and any(cpu_flags().get(flag) for flag in ("avx512_bf16", "amx_bf16"))


def cpu_flags() -> dict[str, bool]:
    """Whether this CPU has each of :data:`CPU_FLAGS`, as far as torch can tell."""
    known = torch.cpu.get_capabilities() if hasattr(torch.cpu, "get_capabilities") else {}
    return {flag: bool(known[name]) for flag, name in CPU_FLAGS.items() if name in known}
