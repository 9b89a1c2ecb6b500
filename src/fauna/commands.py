"""How the small commands (``python -m fauna....``) end: success, or one line on stderr."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from fauna.errors import FaunaError

EXIT_BAD_INPUT = 2


@contextmanager
def one_line_errors() -> Iterator[None]:
    """Print a :class:`FaunaError` as one line and exit with code 2; ``FAUNA_DEBUG=1`` shows the traceback instead."""
    try:
        yield
    except FaunaError as error:
        if os.environ.get("FAUNA_DEBUG"):
            raise
        print(f"fauna: error: {error}", file=sys.stderr)
        sys.exit(EXIT_BAD_INPUT)
