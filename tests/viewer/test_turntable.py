"""The film of one turn: what is in its pictures, that it loops, and that clips are sampled rightly."""

import hashlib
import importlib.util
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image, ImageSequence
from scipy.spatial.transform import Rotation, Slerp

from fauna.errors import FaunaError
from fauna.geometry.camera import to_clip
from fauna.viewer import portrait, turntable_frames, video_suffix, write_turntable, write_video
from fauna.viewer.studio import FILLED, Turntable
from fauna.viewer.turntable import posed_vertices, sample_clip
from tests.viewer.animals import box_animal, swing, textured

needs_encoder = pytest.mark.skipif(importlib.util.find_spec("av") is None, reason="needs the extra video")


@pytest.fixture(scope="module")
def frames():
    return turntable_frames(textured(box_animal()), clip=None, size=64, frames=8, fps=8)


def _colour(picture, channel):
    """Pixels where one channel of 0 (red) or 2 (blue) stands out."""
    return (picture[..., channel].astype(int) - picture[..., 2 - channel]) > 60


def test_every_side_is_seen_once_and_in_its_texture(frames):
    red = np.array([_colour(frame, 0).sum() for frame in frames])
    blue = np.array([_colour(frame, 2).sum() for frame in frames])
    assert red.argmax() in (0, 7)  # it begins with the left side, which is red
    assert blue.argmax() == (red.argmax() + 4) % 8
    assert red[red.argmax()] > 300
    assert blue[red.argmax()] < red[red.argmax()] / 20
    assert all((red + blue) > 200)


def test_the_head_points_to_the_left_when_the_left_side_is_seen():
    animal = box_animal()
    head = np.where(animal.vertices[:, 2:] > 0.5, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    first = turntable_frames(replace(animal, colours=head), clip=None, size=64, frames=8, fps=8)[0]
    assert np.nonzero(_colour(first, 0))[1].mean() < np.nonzero(_colour(first, 2))[1].mean()


def test_the_whole_animal_is_in_every_picture():
    verts = torch.from_numpy(posed_vertices(box_animal(), clip="walk", frames=12, fps=12)).float()
    table = Turntable.around(verts)
    clip = to_clip(verts, table.camera.clip_from_world)
    reach = (clip[..., :2] / clip[..., 3:]).abs().amax()
    assert float(reach) == pytest.approx(FILLED, abs=1e-4)


def test_the_clip_moves_it_and_the_photo_pose_does_not():
    animal = box_animal()
    still = posed_vertices(animal, clip=None, frames=3, fps=8)
    assert np.array_equal(still, posed_vertices(animal, clip="no such clip", frames=3, fps=8))
    assert np.allclose(still, animal.vertices)
    moving = posed_vertices(animal, clip="walk", frames=4, fps=4)
    assert np.allclose(moving[0], animal.vertices)
    assert abs(moving[1] - animal.vertices).max() > 0.1


def test_a_looping_clip_plays_a_whole_number_of_times():
    animal = box_animal()
    verts = posed_vertices(animal, clip="walk", frames=40, fps=16)  # 2.5 s: twice, a little slower
    assert np.allclose(verts[0], verts[20])
    steps = abs(np.diff(np.concatenate([verts, verts[:1]]), axis=0)).max(axis=(1, 2))
    assert steps[-1] < 1.5 * steps.max()
    assert steps.min() > 0


def test_a_clip_with_an_end_runs_once():
    once = replace(swing(), loop=False, times=np.linspace(0.0, 2.0, 9))
    verts = posed_vertices(replace(box_animal(), clips=(once,)), clip="walk", frames=9, fps=1)
    for frame in range(9):
        assert np.allclose(verts[frame], box_animal().pose(once.rotations[frame]))


def test_sampling_equals_spherical_interpolation():
    clip = swing()
    slerp = Slerp(clip.times, Rotation.from_quat(clip.rotations[:, 9]))
    for moment in (0.0, 0.03, 0.125, 0.4, 0.99, 1.0, 5.0):
        got = Rotation.from_quat(sample_clip(clip, moment)[0][9])
        assert (got.inv() * slerp(min(moment, 1.0))).magnitude() < 2e-3
    turned = replace(clip, rotations=clip.rotations * np.array([1, -1] * 4 + [1])[:, None, None])  # the same rotations
    for moment in (0.05, 0.3, 0.77):
        apart = Rotation.from_quat(sample_clip(clip, moment)[0]).inv() * Rotation.from_quat(
            sample_clip(turned, moment)[0]
        )
        assert apart.magnitude().max() < 1e-6


def test_a_clip_of_one_frame_is_a_pose():
    clip = replace(swing(), times=np.zeros(1), rotations=swing().rotations[2:3], translation=np.ones((1, 3)))
    turns, place = sample_clip(clip, 0.7)
    assert np.array_equal(turns, clip.rotations[0])
    assert np.array_equal(place, np.ones(3))
    posed_vertices(replace(box_animal(), clips=(clip,)), clip="walk", frames=3, fps=8)


def test_writes_webp_that_loops(tmp_path, frames):
    write_video(tmp_path / "a.webp", frames, fps=8)
    with Image.open(tmp_path / "a.webp") as film:
        assert film.n_frames == 8
        assert film.info["loop"] == 0
        pictures = [np.asarray(each.convert("RGB")).astype(int) for each in ImageSequence.Iterator(film)]
    assert max(abs(picture - frame).mean() for picture, frame in zip(pictures, frames, strict=True)) < 5
    assert [each.name for each in tmp_path.iterdir()] == ["a.webp"]


@needs_encoder
def test_writes_mp4_and_the_same_bytes_again(tmp_path, frames):
    import av

    for name in ("a.mp4", "b.mp4"):
        write_video(tmp_path / name, frames, fps=8)
    with av.open(str(tmp_path / "a.mp4")) as film:
        pictures = [each.to_ndarray(format="rgb24").astype(int) for each in film.decode(video=0)]
        assert float(film.streams.video[0].average_rate) == 8
    assert max(abs(picture - frame).mean() for picture, frame in zip(pictures, frames, strict=True)) < 8
    digests = {hashlib.sha256((tmp_path / name).read_bytes()).digest() for name in ("a.mp4", "b.mp4")}
    assert len(digests) == 1


def test_names_its_file_by_what_can_be_written(tmp_path, monkeypatch):
    animal = box_animal()
    assert write_turntable(animal, tmp_path, suffix=".webp", size=32, frames=3).name == "turntable.webp"
    assert write_turntable(animal, tmp_path, size=32, frames=3).suffix == video_suffix()
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert video_suffix() == ".webp"


def test_says_how_to_get_an_encoder(tmp_path, frames, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(FaunaError, match=r"pip install -e '\.\[video\]' in the checkout, or write .webp"):
        write_video(tmp_path / "a.mp4", frames, fps=8)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": 0}, "size: expected a whole number from 1"),
        ({"frames": 0}, "frames: expected"),
        ({"fps": 500}, "fps: expected"),
    ],
)
def test_refuses_impossible_numbers(change, message):
    with pytest.raises(FaunaError, match=message):
        turntable_frames(box_animal(), **{"clip": None, "size": 16, "frames": 2, "fps": 8, **change})


def test_refuses_impossible_films(tmp_path, frames):
    with pytest.raises(FaunaError, match="expected a name that ends in .mp4 or .webp, got '.gif'"):
        write_video(tmp_path / "a.gif", frames, fps=8)
    with pytest.raises(FaunaError, match="expected pictures"):
        write_video(tmp_path / "a.webp", [], fps=8)


@needs_encoder
def test_refuses_odd_sides(tmp_path, frames):
    with pytest.raises(FaunaError, match="expected even sides for .mp4, got 63x64"):
        write_video(tmp_path / "a.mp4", [frame[:, 1:] for frame in frames], fps=8)


def test_drawing_is_deterministic(frames):
    again = turntable_frames(textured(box_animal()), clip=None, size=64, frames=8, fps=8)
    assert all(np.array_equal(a, b) for a, b in zip(frames, again, strict=True))


def test_a_portrait_is_the_first_picture_of_a_still_animal():
    animal = box_animal()
    first = turntable_frames(animal, clip=None, size=48, frames=1, fps=1)[0]
    again = portrait(torch.from_numpy(animal.vertices), torch.from_numpy(animal.faces), size=48)
    assert np.array_equal(again, first)
