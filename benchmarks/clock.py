"""Times of the parts of something, collected from inside it."""

import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Clock:
    """Adds up the milliseconds of each part of what is under way."""

    parts: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    def timed(self, part: str, function: Callable) -> Callable:
        """The same function, with its time added to a part."""

        def wrapper(*args: Any, **kwargs: Any) -> Any:
            start = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                self.parts[part] += 1e3 * (time.perf_counter() - start)

        return wrapper
