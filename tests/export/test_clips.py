"""Clips: feet hold the ground, loops close, gaits step in their order, whatever the animal."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fauna.export import glb_bytes
from fauna.export.gait import TROT, WALK, stands
from fauna.export.joints import JOINT, LEGS, NUM_JOINTS
from fauna.export.legs import bend, legs_of, shortest_turn
from fauna.export.rig import rig_animal
from fauna.export.slide import foot_slide, sample
from fauna.export.stance import stance_of
from tests.export.objects import RIG, animal, rest_animal
from tests.export.reader import Player

SEEDS = range(8)
NAMES = ("idle", "walk", "trot", "look_around")


@pytest.fixture(scope="module")
def animals():
    return [animal(seed) for seed in SEEDS]


def clip_of(rigged, name):
    (found,) = [clip for clip in rigged.clips if clip.name == name]
    return found


def test_every_animal_has_every_clip(animals):
    for rigged in animals:
        assert tuple(clip.name for clip in rigged.clips) == NAMES
        assert rigged.notes == ()
        for clip in rigged.clips:
            assert set(clip.extras["footfalls"]) == {leg.name for leg in LEGS}


@pytest.mark.parametrize("name", NAMES)
def test_feet_do_not_slide(animals, name):
    for rigged in animals:
        slides = foot_slide(rigged, clip_of(rigged, name))
        assert len(slides) == 4
        assert max(slides.values()) < 0.03
        assert clip_of(rigged, name).extras["foot_slide"] == max(slides.values())


def test_slide_is_that_of_the_vertices_as_they_are_posed(animals):
    """Against a loop over a player's pictures of the whole mesh."""
    rigged = animals[4]
    clip = clip_of(rigged, "trot")
    duty, period = clip.extras["duty_factor"], clip.times[-1]
    slides = foot_slide(rigged, clip)
    for leg in legs_of(rigged):
        places = []
        for since in duty * period * np.linspace(0.0, 1.0, 60):
            rotations, translation = sample(
                clip, np.array([(clip.extras["footfalls"][leg.joints.name] * period + since) % period])
            )
            posed = rigged.pose(rotations[0], translation[0])[leg.sole_vertices]
            places.append(posed + (0.0, 0.0, clip.speed * since))
        apart = np.linalg.norm(np.array(places) - places[30], axis=2).max() / leg.length
        assert slides[leg.joints.name] == pytest.approx(apart, rel=1e-6)


def test_slide_is_seen_when_there_is_some(animals):
    """The same walk over ground that goes by at another speed, and with a hip that turns once too much."""
    walk = clip_of(animals[0], "walk")
    fast = foot_slide(animals[0], replace(walk, speed=1.3 * walk.speed))
    step = 0.3 * walk.speed * walk.extras["duty_factor"] * walk.times[-1]
    for leg in legs_of(animals[0]):
        assert fast[leg.joints.name] == pytest.approx(0.5 * step / leg.length, rel=0.1)


@pytest.mark.parametrize("name", ["walk", "trot"])
def test_soles_of_the_mesh_hold_the_ground_as_a_player_shows_them(animals, name):
    """From the file's bytes: every vertex of a sole with its four weights."""
    for rigged in animals[:3]:
        clip = clip_of(rigged, name)
        player, period, duty = (
            Player.of(glb_bytes(rigged)),
            float(np.float32(clip.times[-1])),
            clip.extras["duty_factor"],
        )
        for leg in legs_of(rigged):
            carried = np.flatnonzero(rigged.influences[:, 0] == leg.joints.joints[2])
            lowest = carried[rigged.vertices[carried, 1] <= rigged.vertices[carried, 1].min() + 0.03 * leg.length]
            since = duty * period * np.array([0.02, 0.27, 0.55, 0.81, 0.98])
            times = (clip.extras["footfalls"][leg.joints.name] * period + since) % period
            places = np.array([player.vertices(name, time)[lowest] for time in times])
            places[..., 2] += clip.speed * since[:, None]
            assert np.abs(places - places[2]).max() < 0.03 * leg.length


@pytest.mark.parametrize("name", NAMES)
def test_loops_close(animals, name):
    for rigged in animals:
        clip = clip_of(rigged, name)
        assert clip.loop
        assert clip.times[0] == 0
        assert (np.diff(clip.times) > 0).all()
        first, last = (rigged.pose(clip.rotations[frame], clip.translation[frame]) for frame in (0, -1))
        np.testing.assert_allclose(first, last, atol=1e-9)
        speeds = np.linalg.norm(
            np.diff(rigged.joint_transforms(clip.rotations, clip.translation)[..., :3, 3], axis=0), axis=2
        )
        assert speeds.max() < 0.25 * rigged.body_length  # no joint jumps between two frames
        np.testing.assert_allclose(np.linalg.norm(clip.rotations, axis=2), 1.0)


@pytest.mark.parametrize(("gait", "order"), [
    (WALK, ["hind_left", "front_left", "hind_right", "front_right"]),
    (TROT, ["front_right", "hind_left", "front_left", "hind_right"]),
])  # fmt: skip
def test_feet_come_down_in_order(animals, gait, order):
    """Seen on the posed soles: the frame after which each foot stays low."""
    rigged = animals[1]
    clip = clip_of(rigged, gait.name)
    moved = rigged.joint_transforms(clip.rotations[:-1], clip.translation[:-1])
    landings = {}
    for leg in legs_of(rigged):
        foot = leg.joints.joints[2]
        rest = np.linalg.inv(rigged.frames[foot]) @ (leg.sole - rigged.starts[foot])
        height = moved[:, foot, 1, :3] @ rest + moved[:, foot, 1, 3]
        low = height < 1e-6
        (landing,) = np.flatnonzero(low & ~np.roll(low, 1))
        landings[leg.joints.name] = landing / gait.frames
        assert low.mean() == pytest.approx(gait.duty, abs=1.5 / gait.frames)
        assert height.max() == pytest.approx(gait.lift * stance_of(rigged).hip_height, rel=0.05)
    assert sorted(landings, key=lambda name: (landings[name], name)) == sorted(
        order, key=lambda name: (landings[name], name)
    )
    assert landings == pytest.approx(clip.extras["footfalls"])
    if gait is WALK:
        assert sorted(landings.values()) == [0.0, 0.25, 0.5, 0.75]
        assert sorted(landings, key=landings.__getitem__) == order
    else:
        assert landings["front_left"] == landings["hind_right"] != landings["front_right"] == landings["hind_left"]


def test_small_animals_step_faster_and_shorter():
    small, large = animal(3, back_height=0.3), animal(3, back_height=1.2)
    for name in ("walk", "trot"):
        few, many = clip_of(small, name), clip_of(large, name)
        assert many.times[-1] == pytest.approx(2.0 * few.times[-1])
        assert many.speed == pytest.approx(2.0 * few.speed)


def test_the_head_looks_to_both_sides(animals):
    rigged = animals[2]
    clip = clip_of(rigged, "look_around")
    head = rigged.joint_transforms(clip.rotations, clip.translation)[:, JOINT["head"]]
    sideways = head[:, 0, 1]  # of the direction along the bone
    assert sideways.max() > 0.4
    assert sideways.min() < -0.4


def test_legs_that_hang_from_nothing_walk_too():
    loose = animal(5, attached=False)
    for clip in loose.clips:
        assert clip.extras["foot_slide"] < 0.03


def test_a_leg_in_the_air_is_left_alone_and_said():
    """Hind legs that end high above the ground: a tail that was taken for them."""
    rest = rest_animal(6)
    ends = rest.skeleton.ends.clone()
    starts = rest.skeleton.starts.clone()
    for leg in (11, 14):
        hip = starts[0, leg + 2].clone()
        for part, share in ((2, 0.0), (1, 0.1), (0, 0.2)):
            starts[0, leg + part, 1] = hip[1] - share
            ends[0, leg + part, 1] = hip[1] - share - 0.1
    rigged = rig_animal(
        RIG, replace(rest, skeleton=replace(rest.skeleton, starts=starts, ends=ends)), name="x", back_height=1.0
    )
    assert rigged.notes == ("hind legs: their bones do not reach the ground, clips leave them straight",)
    for clip in rigged.clips:
        assert set(clip.extras["footfalls"]) == {"front_left", "front_right"}
        np.testing.assert_allclose(clip.rotations[:, JOINT["hind_left_lower"], :3], 0.0, atol=1e-12)


def test_legs_that_lie_in_each_other_step_together():
    rest = rest_animal(7)
    starts, ends = rest.skeleton.starts.clone(), rest.skeleton.ends.clone()
    for front, hind in ((8, 11), (17, 14)):
        for part in range(3):
            starts[0, front + part], ends[0, front + part] = starts[0, hind + part], ends[0, hind + part]
    rigged = rig_animal(
        RIG, replace(rest, skeleton=replace(rest.skeleton, starts=starts, ends=ends)), name="x", back_height=1.0
    )
    assert rigged.notes == ("front legs: their bones lie in the other legs and go with them",)
    falls = clip_of(rigged, "walk").extras["footfalls"]
    assert falls["front_left"] == falls["hind_left"] != falls["front_right"] == falls["hind_right"]
    assert clip_of(rigged, "walk").extras["foot_slide"] < 0.03


@pytest.mark.parametrize("front", [True, False])
def test_bending_reaches_the_target(front):
    rigged = animal(8)
    leg = next(leg for leg in legs_of(rigged) if leg.joints.front == front)
    generator = np.random.default_rng(0)
    directions = generator.normal(size=(50, 3)) * (0.3, 0.1, 0.4) - (0.0, 1.0, 0.0)
    reach = generator.uniform(0.65, 0.98, 50) * leg.reach
    targets = directions / np.linalg.norm(directions, axis=1, keepdims=True) * reach[:, None]
    feet = Rotation.random(50, rng=generator).as_matrix()
    turns = bend(leg, targets, feet, knee_forward=not front)
    upper, lower, _ = np.diff(leg.points, axis=0)
    for turn, target, foot in zip(turns, targets, feet, strict=True):
        np.testing.assert_allclose(turn[0] @ (upper + turn[1] @ lower), target, atol=1e-6)
        np.testing.assert_allclose(turn[0] @ turn[1] @ turn[2], foot, atol=1e-12)
        knee = turn[0] @ upper
        line = target / np.linalg.norm(target)
        off = knee - line * (knee @ line)
        assert (off[2] < 0) == front  # elbows point backwards, knees forwards


@pytest.mark.parametrize("name", NAMES)
def test_standing_feet_do_not_roll_and_lifted_ones_fold_back(animals, name):
    for rigged in animals[:3]:
        clip = clip_of(rigged, name)
        moved = rigged.joint_transforms(clip.rotations, clip.translation)[..., :3, :3]
        phase = np.linspace(0.0, 1.0, len(clip.times))
        for leg in legs_of(rigged):
            foot = leg.joints.joints[2]
            turned = moved[:, foot] @ rigged.frames[foot].T
            standing = (phase - clip.extras["footfalls"][leg.joints.name]) % 1.0 <= clip.extras["duty_factor"]
            np.testing.assert_allclose(turned[standing], np.tile(np.eye(3), (standing.sum(), 1, 1)), atol=1e-9)
            if not standing.all():
                backwards = -turned[~standing, 2, 1]  # of what points down at rest
                assert backwards.min() < -0.3


def test_shortest_turns():
    generator = np.random.default_rng(1)
    source, target = generator.normal(size=(2, 30, 3))
    target[0], source[1] = -source[0], target[1]
    source[0] = (0.0, 0.0, 2.0)
    target[0] = (0.0, 0.0, -1.0)
    turns = shortest_turn(source, target)
    moved = np.einsum("fab,fb->fa", turns, source)
    cosine = np.einsum("fk,fk->f", moved, target) / np.linalg.norm(moved, axis=1) / np.linalg.norm(target, axis=1)
    np.testing.assert_allclose(cosine, 1.0)
    angle = np.arccos(((np.trace(turns, axis1=1, axis2=2) - 1) / 2).clip(-1, 1))
    lengths = np.linalg.norm(source, axis=1) * np.linalg.norm(target, axis=1)
    between = np.arccos((np.einsum("fk,fk->f", source, target) / lengths).clip(-1, 1))
    np.testing.assert_allclose(angle, between, atol=1e-6)


def test_between_frames_rotations_are_mixed_as_scipy_does(animals):
    from scipy.spatial.transform import Rotation, Slerp

    clip = clip_of(animals[0], "walk")
    times = np.array([0.0, 0.01, 0.123, 0.4, clip.times[-1]])
    rotations, translation = sample(clip, times)
    for joint in range(NUM_JOINTS):
        expected = Slerp(clip.times, Rotation.from_quat(clip.rotations[:, joint]))(times)
        apart = (expected.inv() * Rotation.from_quat(rotations[:, joint])).magnitude()
        assert apart.max() < 1e-6
    np.testing.assert_allclose(translation[0], clip.translation[0])
    np.testing.assert_allclose(translation[-1], clip.translation[-1])


def test_feet_stand_below_their_hips(animals):
    for rigged in animals:
        for leg in legs_of(rigged):
            place = stands(leg)
            assert place[1] == 0
            assert abs(place[2] - leg.hip[2]) <= 0.08 * leg.length + 1e-12
