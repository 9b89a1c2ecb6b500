"""What a run depends on beside its configuration."""

import platform

import numba
import numpy
import torch

import fauna


def environment() -> dict[str, str]:
    """What bit-for-bit equality of a resumed run depends on."""
    return {
        "fauna": fauna.__version__,
        "torch": str(torch.__version__),  # a plain string, or the checkpoint cannot be read back
        "numpy": numpy.__version__,
        "numba": numba.__version__,
        "python": platform.python_version(),
        "machine": f"{platform.machine()} {torch.backends.cpu.get_cpu_capability()}",
        "threads": str(torch.get_num_threads()),
    }
