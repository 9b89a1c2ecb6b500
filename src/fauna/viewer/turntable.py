"""A film of one turn around an animal, walking where it can."""

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8

from fauna.errors import FaunaError
from fauna.export.animal import Clip, RiggedAnimal
from fauna.renderer.numba_backend import NumbaRenderer
from fauna.viewer.studio import Paint, Turntable, draw
from fauna.viewer.video import video_suffix, write_video

WALK = "walk"
"""The clip that plays when there is one and none is named."""


def write_turntable(
    animal: RiggedAnimal,
    folder: Path,
    *,
    suffix: str | None = None,
    clip: str | None = WALK,
    size: int = 320,
    frames: int = 48,
    fps: int = 16,
) -> Path:
    """Write ``turntable.mp4`` or, without an encoder, ``turntable.webp``.

    Args:
        animal: to be seen.
        folder: where to; it is made.
        suffix: ``.mp4`` or ``.webp``; ``None`` takes what can be written.
        clip: that plays meanwhile; ``None``, or one that the animal does not have, shows the photo's pose.
        size: side of the film, pixels.
        frames: pictures of one turn.
        fps: pictures per second.

    Returns:
        The file.

    Raises:
        FaunaError: when a number is out of range, or there is no encoder for a suffix that was asked for.
    """
    path = folder / f"turntable{suffix or video_suffix()}"
    write_video(path, turntable_frames(animal, clip=clip, size=size, frames=frames, fps=fps), fps=fps)
    return path


@torch.no_grad()
def turntable_frames(
    animal: RiggedAnimal, *, clip: str | None, size: int, frames: int, fps: int
) -> list[UInt8[np.ndarray, "size size 3"]]:
    """The pictures of one turn; the clip plays a whole number of times, so that the film can be looped.

    Args:
        animal: to be seen.
        clip: that plays meanwhile; ``None``, or one that the animal does not have, shows the photo's pose.
        size: side of a picture, pixels.
        frames: pictures of one turn.
        fps: pictures per second, from which follows how often the clip plays.

    Raises:
        FaunaError: when a number is out of range.
    """
    for name, value, high in (("size", size, 2048), ("frames", frames, 1000), ("fps", fps, 120)):
        if not 1 <= value <= high:
            raise FaunaError(f"{name}: expected a whole number from 1 to {high}, got {value}; give another number")
    verts = torch.from_numpy(posed_vertices(animal, clip=clip, frames=frames, fps=fps)).float()
    faces, paint, table, renderer = (
        torch.from_numpy(animal.faces),
        Paint.of(animal),
        Turntable.around(verts),
        NumbaRenderer(),
    )
    return [draw(renderer, verts, faces, paint, table, frame, size=size) for frame in range(frames)]


def posed_vertices(
    animal: RiggedAnimal, *, clip: str | None, frames: int, fps: int
) -> Float[np.ndarray, "frame vert 3"]:
    """Vertices in each picture; a clip that does not end as it began runs once."""
    playing = next((each for each in animal.clips if each.name == clip), None)
    if playing is None:
        return np.repeat(animal.pose(animal.photo)[None], frames, axis=0)
    duration = float(playing.times[-1])
    if not playing.loop:
        moments = np.linspace(0.0, duration, frames)
    else:
        rounds = max(1, round(frames / fps / duration)) if duration else 1
        moments = np.arange(frames) / frames * rounds * duration % max(duration, 1e-9)
    return np.stack([animal.pose(*sample_clip(playing, moment)) for moment in moments])


def sample_clip(clip: Clip, moment: float) -> tuple[Float[np.ndarray, "21 4"], Float[np.ndarray, " 3"]]:
    """Rotations and the root's translation at a moment, in seconds; before and after the clip its ends."""
    after = int(np.clip(np.searchsorted(clip.times, moment, side="right"), 1, max(len(clip.times) - 1, 1)))
    if len(clip.times) == 1:
        return clip.rotations[0], clip.translation[0]
    before = after - 1
    share = np.clip((moment - clip.times[before]) / (clip.times[after] - clip.times[before]), 0.0, 1.0)
    first, second = clip.rotations[before], clip.rotations[after]
    second = np.where((first * second).sum(-1, keepdims=True) < 0, -second, second)  # the shorter way round
    mixed = (1 - share) * first + share * second
    turn = mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)
    return turn, (1 - share) * clip.translation[before] + share * clip.translation[after]
