"""Which photographs belong to which shard: a stable hash of what must stay together."""

import hashlib
import re
from dataclasses import dataclass

from fauna.errors import FaunaError


@dataclass(frozen=True)
class Shard:
    """One of ``count`` parts of a set.

    Attributes:
        index: from 0.
        count: of all shards.
    """

    index: int
    count: int

    def __contains__(self, group: str) -> bool:
        """Whether the photographs of a group belong to the shard."""
        return shard_of(group, self.count) == self.index

    @property
    def stem(self) -> str:
        """Of its tables and journals.

        >>> Shard(3, 16).stem
        '00003-of-00016'
        """
        return f"{self.index:05d}-of-{self.count:05d}"


def shard_of(group: str, count: int) -> int:
    """The shard of a group of photographs: neither the machine nor the order of listing matters.

    >>> shard_of("horse/1.jpg", 1)
    0
    """
    digest = hashlib.blake2b(group.encode("utf-8", "surrogateescape"), digest_size=8).digest()
    return int.from_bytes(digest, "big") % count


def parse_shard(text: str) -> Shard:
    """``3/16`` as the fourth of sixteen shards.

    Raises:
        FaunaError: for anything else.
    """
    match = re.fullmatch(r"(\d{1,5})/(\d{1,5})", text)
    if match is None or not int(match[1]) < int(match[2]):
        raise FaunaError(f"shard: expected i/n with 0 <= i < n, got {text!r}; e.g. shard=0/16 to shard=15/16")
    return Shard(int(match[1]), int(match[2]))
