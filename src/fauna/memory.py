"""How the process treats memory it has freed."""

import ctypes

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # parameters of glibc's mallopt
KEEP, LARGEST = 1 << 30, 1 << 25  # bytes


def keep_freed_memory() -> None:
    """Let the C library keep up to 1 GiB of freed memory for the next step instead of handing it back.

    A step on CPU allocates and frees the same large tensors again and again; by default each of them is unmapped and
    its pages are fetched and cleared anew. Without effect where the C library is not glibc.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError, TypeError):
        return
    if not mallopt(MMAP_THRESHOLD, KEEP):
        mallopt(MMAP_THRESHOLD, LARGEST)  # the most that older versions accept
    mallopt(TRIM_THRESHOLD, KEEP)
