"""Where matrix products of learned fields may run in bfloat16. Geometry, cameras and losses are always float32."""

from contextlib import AbstractContextManager
from typing import Literal

import torch

Precision = Literal["float32", "bfloat16", "auto"]
"""``auto`` is bfloat16 where the hardware multiplies it natively, float32 elsewhere."""


def matmul_precision(precision: Precision, device: torch.device) -> AbstractContextManager:
    """Context in which linear layers and convolutions on ``device`` run in a precision; sums stay float32."""
    reduced = precision == "bfloat16" or (precision == "auto" and native_bfloat16(device))
    return torch.autocast(device.type, dtype=torch.bfloat16, enabled=reduced)


def native_bfloat16(device: torch.device) -> bool:
    """Whether bfloat16 matrix products gain anything on a device."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    return device.type == "cpu" and bool({"avx512_bf16", "amx_bf16"} & set(cpu_flags()))


def cpu_flags() -> tuple[str, ...]:
    """Vector instruction sets of this CPU that matter here, as far as torch can tell."""
    checks = {
        "avx2": torch.cpu._is_avx2_supported,
        "avx512f": torch.cpu._is_avx512_supported,
        "avx512_bf16": torch.cpu._is_avx512_bf16_supported,
        "amx_bf16": torch.cpu._is_amx_tile_supported,
    }
    return tuple(name for name, check in checks.items() if check())
