"""Pictures as a short film: MP4 where an encoder is installed, animated WebP by Pillow everywhere."""

import importlib.util
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from fauna.errors import FaunaError

ENCODING = {"crf": "23", "preset": "veryfast", "x264-params": "mbtree=0"}
"""Options of H.264. With mbtree the same pictures gave different files within one process; without it they are a third larger."""


def video_suffix() -> str:
    """``.mp4`` when an encoder is installed, else ``.webp``."""
    return ".mp4" if importlib.util.find_spec("av") else ".webp"


def write_video(path: Path, frames: Sequence[UInt8[np.ndarray, "height width 3"]], *, fps: int) -> None:
    """Write an endless loop (WebP) or a film (MP4, H.264); the file appears when it is complete.

    Args:
        path: ends in ``.mp4`` or ``.webp``.
        frames: 8-bit RGB pictures of one size; for MP4 with even sides.
        fps: pictures per second.

    Raises:
        FaunaError: for another suffix, an odd side, no pictures, or a missing encoder.
    """
    if not frames:
        raise FaunaError(f"{path}: expected pictures for a film, got none; give at least one")
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.stem}.partial{path.suffix}")
    if path.suffix == ".mp4":
        _write_mp4(partial, frames, fps)
    elif path.suffix == ".webp":
        first, *others = (Image.fromarray(frame) for frame in frames)
        first.save(partial, save_all=True, append_images=others, duration=1000 // fps, loop=0, quality=75, method=0)
    else:
        raise FaunaError(f"{path}: expected a name that ends in .mp4 or .webp, got {path.suffix!r}; rename it")
    partial.replace(path)


def _write_mp4(path: Path, frames: Sequence[UInt8[np.ndarray, "height width 3"]], fps: int) -> None:
    try:
        import av
    except ImportError as error:
        raise FaunaError(
            f"{path}: expected an encoder for .mp4, got none; pip install -e '.[video]' in the checkout, or write .webp"
        ) from error
    height, width = frames[0].shape[:2]
    if height % 2 or width % 2:
        raise FaunaError(f"{path}: expected even sides for .mp4, got {width}x{height}; choose another size")
    with av.open(str(path), "w", format="mp4", options={"movflags": "faststart"}) as film:
        stream = film.add_stream("libx264", rate=Fraction(fps), options=dict(ENCODING))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.thread_count = 1
        for number, frame in enumerate(frames):
            picture = av.VideoFrame.from_ndarray(frame, format="rgb24").reformat(format="yuv420p")
            picture.pts, picture.time_base = number, Fraction(1, fps)
            film.mux(stream.encode(picture))
        film.mux(stream.encode())
