"""CPU threads: one number for torch and numba, and work done beside the thread that trains."""

import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import torch

from fauna.memory import keep_freed_memory
from fauna.precision import cpu_flags

Item = TypeVar("Item")
Result = TypeVar("Result")


def set_threads(threads: int | None) -> None:
    """Let torch and the compiled kernels use the same number of threads, from now on.

    Starting numba's pool sets OpenMP's thread count for the calling thread, and with it torch's: without this call the
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


def in_background(
    function: Callable[[Item], Result], items: Iterable[Item], *, workers: int, ahead: int
) -> Iterator[Result]:
    """``map(function, items)``, computed by other threads up to ``ahead`` items before it is asked for.

    Order and values are those of ``map`` if ``function`` is pure: inside the workers torch and numba use one thread, and the
    calling thread keeps its own number (both counts belong to a thread; only threads that start later inherit torch's).
    An exception is raised where its result is asked for. When the iterator ends, fails or is closed, what has not begun is
    dropped and what has is waited for.

    Args:
        function: called with one item, from several threads at a time if ``workers > 1``.
        items: taken lazily, ``ahead`` more than were asked for.
        workers: threads.
        ahead: results that may wait; 0 computes each in the calling thread when it is asked for.
    """
    if ahead < 1:
        yield from map(function, items)
        return
    waiting: deque[Future[Result]] = deque()
    pool = ThreadPoolExecutor(workers, thread_name_prefix="fauna", initializer=_single_threaded)
    try:
        for item in items:
            waiting.append(pool.submit(function, item))
            if len(waiting) > ahead:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def describe_cpu() -> str:
    """Threads in use and the instruction sets that matter, e.g. ``2 threads, avx2 avx512f avx512_bf16 (no amx_bf16)``."""
    flags = cpu_flags()
    found, absent = ([flag for flag, has in flags.items() if has is wanted] for wanted in (True, False))
    text = " ".join(found) + (f" (no {', '.join(absent)})" if absent else "")
    count = torch.get_num_threads()
    return f"{count} thread{'s' if count != 1 else ''}, {text or 'instruction sets unknown'}"


def _single_threaded() -> None:
    """Make the calling thread do its own work alone."""
    if "numba" in sys.modules:
        sys.modules["numba"].set_num_threads(1)  # before torch: it may start the pool, which sets torch's count
    torch.set_num_threads(1)
