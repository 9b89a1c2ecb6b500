"""Video files: frames at a steady rate, unpacked once beside the tables. Needs the extra ``video`` (PyAV)."""

import hashlib
import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fauna.errors import FaunaError
from fauna.prepare.record import Rows
from fauna.prepare.shard import Shard
from fauna.prepare.sources.base import Source
from fauna.prepare.sources.folders import TRANSPARENT
from fauna.prepare.sources.naming import Naming
from fauna.prepare.sources.walking import walk
from fauna.prepare.workspace import write_file

SUFFIXES = frozenset({".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv"})
JPEG_QUALITY = 95
LIST = "frames.json"
"""In the folder of a video's frames, written last: the frames are complete."""


@dataclass(frozen=True)
class VideoSource(Source):
    """Video files in ``SOURCE/<species>/`` or in SOURCE, or one file.

    The frames of a video are unpacked when it is listed, and only for the shard that is asked for.

    Attributes:
        root: folder, or a video file.
        naming: of the rows.
        shard: whose videos are unpacked and listed, ``None`` for all.
    """

    root: Path
    naming: Naming
    shard: Shard | None
    kind: str = "videos"
    keypoint_names: tuple[str, ...] | None = None

    def photos(self) -> Iterator[Rows]:
        """Frames in the order of time, video by video."""
        av = _pyav()
        for path in self._files():
            group = self.naming.text(path)
            if self.shard is not None and group not in self.shard:
                continue
            folder = self.naming.workspace.unpacked / "frames" / _folder_name(group)
            numbers = unpack_video(av, path, folder, self.naming.settings.frames_per_second)
            if isinstance(numbers, str):
                yield (self.naming.unusable(group, numbers, "unreadable", self._species(path)),)
                continue
            for number in numbers:
                frame = folder / _frame_name(number)
                yield (self.naming.row(frame, self._species(path), group=group, frame=number, origin=group),)

    def _files(self) -> Iterator[Path]:
        if self.root.is_file():
            yield self.root
            return
        for path in walk(self.root, avoid=self.naming.results):
            if isinstance(path, Path) and is_video(path):
                yield path

    def _species(self, path: Path) -> str | None:
        if self.root.is_file():
            return None
        parts = path.parent.relative_to(self.root).parts
        return next((part for part in parts if part.lower() not in TRANSPARENT | {"videos", "clips"}), None)


def is_video(path: Path) -> bool:
    """Whether a file's name is that of a video."""
    return path.suffix.lower() in SUFFIXES and not path.name.startswith(".")


def unpack_video(av: Any, path: Path, folder: Path, rate: float) -> list[int] | str:
    """Frames of a video as JPEG files; nothing is done where they are already.

    Args:
        av: the package.
        path: of the video.
        folder: of the frames.
        rate: frames for each second of the video; the first frame at or after each moment is taken.

    Returns:
        Their numbers, or in words why there is none. A damaged video gives the frames before the damage.
    """
    found = path.stat()
    stamp = {"bytes": found.st_size, "mtime_ns": found.st_mtime_ns, "frames_per_second": rate}
    try:
        known = json.loads((folder / LIST).read_text(encoding="utf-8"))
        if known["stamp"] == stamp:
            return known["frames"]
    except (OSError, ValueError, KeyError):
        pass
    numbers: list[int] = []
    reason = "it has no picture"
    try:
        with av.open(str(path)) as container:
            for number, picture in _chosen(container, rate):
                buffer = io.BytesIO()
                picture.save(buffer, "JPEG", quality=JPEG_QUALITY)
                write_file(folder / _frame_name(number), buffer.getvalue())
                numbers.append(number)
    except (av.error.FFmpegError, IndexError, ValueError) as error:
        reason = " ".join(str(error).split())[:120]
    if numbers:
        write_file(folder / LIST, json.dumps({"stamp": stamp, "frames": numbers}).encode())
    return numbers or reason


def _chosen(container: Any, rate: float) -> Iterator[tuple[int, Any]]:
    """Number and picture of the frames that are looked at."""
    stream = container.streams.video[0]
    stream.thread_type = "NONE"  # the same frames with any number of threads, also of damaged files
    due = 0.0
    for number, frame in enumerate(container.decode(stream)):
        time = frame.time if frame.time is not None else number / float(stream.average_rate or 25)
        if time + 1e-6 >= due:
            due = max(due + 1.0 / rate, time + 0.5 / rate)
            yield number, frame.to_image()


def _frame_name(number: int) -> str:
    return f"{number:07d}.jpg"


def _folder_name(group: str) -> str:
    return hashlib.blake2b(group.encode(), digest_size=8).hexdigest()


def _pyav() -> Any:
    try:
        import av
    except ImportError as error:
        raise FaunaError(
            "videos: expected the package av, got none; pip install -e '.[video]' in the checkout"
        ) from error
    return av
