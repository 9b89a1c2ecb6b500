"""Locks that keep two runs from writing the same files. They vanish with the process that holds them, however it ends."""

import errno
import fcntl
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from fauna.errors import FaunaError

NO_LOCKS = frozenset({errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS, errno.EINVAL, errno.EBADF, errno.EIO})
"""What file systems say that know no locks, or none of folders (NFS)."""

_told = False


def lock(file: int, *, wait: bool) -> bool:
    """Lock an open file or folder.

    Args:
        file: descriptor; closing it unlocks.
        wait: until whoever has it lets go.

    Returns:
        Whether nobody else has it. True where the file system has no locks, after one line on stderr that says so.

    Raises:
        OSError: when it cannot be locked for another reason.
    """
    global _told
    try:
        fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        if not _told:
            print("fauna: warning: this file system has no locks; see to it that runs do not meet", file=sys.stderr)
        _told = True
    return True


@contextmanager
def only_run(work: Path, dest: Path) -> Iterator[None]:
    """Hold a set for as long as it is written by a command that sees all of it.

    The work folder is locked by a file, and DEST itself, because another command may make it by way of another work folder.

    Args:
        work: folder of tables.
        dest: folder of the set.

    Raises:
        FaunaError: when another run holds either.
    """
    with ExitStack() as held:
        for path, flags in ((work / "set.lock", os.O_RDWR | os.O_CREAT), (dest, os.O_RDONLY)):
            file = os.open(path, flags, 0o644)
            held.callback(os.close, file)
            if not lock(file, wait=False):
                raise FaunaError(
                    f"DEST: expected one run for {dest}, got another that is at work on it; wait for it to end"
                )
        yield


@contextmanager
def one_at_a_time(path: Path) -> Iterator[None]:
    """Wait until no other process is within such a block for ``path``, a file that is made for it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        lock(file, wait=True)
        yield
    finally:
        os.close(file)
