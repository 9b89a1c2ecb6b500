"""One number of CPU threads for torch and numba."""

import torch

from fauna.memory import keep_freed_memory


def set_threads(threads: int | None) -> None:
    """Let torch and the compiled kernels use the same number of threads, from now on.

    Starting numba's pool sets OpenMP's thread count for the whole process, and with it torch's: without this call the
    first kernel of a run would change the rounding of every later step, and a resumed run would differ from an
    uninterrupted one.

    Args:
        threads: number of threads; ``None`` = what torch uses now.
    """
    keep_freed_memory()
    wanted = torch.get_num_threads() if threads is None else threads
    try:
        import numba
    except ImportError:
        torch.set_num_threads(wanted)
        return
    most = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    numba.set_num_threads(min(wanted, most))  # starts the pool
    torch.set_num_threads(wanted)
