"""A file on its own, or one inside of a packed shard: what the readers of crops open."""

import io
from dataclasses import dataclass
from pathlib import Path

from fauna.errors import FaunaError


@dataclass(frozen=True)
class Member:
    """Bytes of a shard that were a file.

    Attributes:
        shard: the tar file.
        name: of the file in it.
        offset: of its first byte.
        size: bytes.
    """

    shard: Path
    name: str
    offset: int
    size: int

    def read_bytes(self) -> bytes:
        """Its content.

        Raises:
            FaunaError: when the shard ends before.
            OSError: when it cannot be read.
        """
        with self.shard.open("rb", buffering=0) as file:
            file.seek(self.offset)
            content = file.read(self.size)
        if len(content) != self.size:
            raise FaunaError(f"{self} expects {self.size} bytes, got {len(content)}; copy the shard again")
        return content

    def read_text(self, encoding: str, errors: str = "strict") -> str:
        """Its content as text."""
        return self.read_bytes().decode(encoding, errors)

    def is_file(self) -> bool:
        """Whether the shard is there."""
        return self.shard.is_file()

    def __str__(self) -> str:
        return f"{self.shard}:{self.name}"


StoredFile = Path | Member
"""What a crop's files may be."""


def readable(file: StoredFile) -> Path | io.BytesIO:
    """What Pillow opens."""
    return io.BytesIO(file.read_bytes()) if isinstance(file, Member) else file
