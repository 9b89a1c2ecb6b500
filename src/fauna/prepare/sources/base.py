"""What every kind of source gives."""

from abc import ABC, abstractmethod
from collections.abc import Iterator

from fauna.prepare.record import Rows


class Source(ABC):
    """A pile of photographs, listed without opening them.

    Attributes:
        kind: as ``source.kind`` names it.
        keypoint_names: canonical names of the keypoints in every row's order, ``None`` when nothing has keypoints.
    """

    kind: str
    keypoint_names: tuple[str, ...] | None

    @abstractmethod
    def photos(self) -> Iterator[Rows]:
        """The rows of every photograph, each photograph once, in an order that is the same on every machine.

        Memory stays bounded where the source allows it (folders, CSV). Annotations that cannot be used are rows too, rejected with
        ``scan:annotation`` (their ``origin`` says why) or ``scan:missing``. Video files are unpacked to frames below
        ``workspace.unpacked`` while they are listed; their rows have ``source="work:unpacked/..."``, ``group`` = the video and
        ``frame``. All rows of one photograph share ``photo``, ``source`` and ``group``.
        """
