"""The herd on a small model made from the zoo's horse: poses, truth, determinism, views."""

from pathlib import Path

import numpy as np
import pytest

from fauna.errors import FaunaError
from fauna.kernels.zoo_raster import rasterise
from fauna.models3d.animal import prepare
from fauna.models3d.clips import Clip
from fauna.models3d.coat import base_colours, openness, paint
from fauna.models3d.herd import Herd, HerdSample
from fauna.models3d.load import load_model
from fauna.models3d.model import pose
from fauna.models3d.posing import Build, pose_animal, sample_moment
from fauna.models3d.retarget import Skeleton, borrow, local_from_world
from fauna.zoo.body import KEYPOINTS
from fauna.zoo.surface import vertex_normals
from fauna.zoo.view import project
from tests.models3d.glb_writer import write_quadruped
from tests.models3d.test_refine import CUBE, CUBE_FACES

SIZE = 64
PLAIN = Build(np.ones(3), 1.0, 1.0, 1.0, np.zeros(2))


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("models")
    write_quadruped(root / "Pony.glb")
    write_quadruped(root / "more" / "Still.glb", clips=False, squeeze=0.8)
    return root


@pytest.fixture(scope="module")
def herd(folder) -> Herd:
    return Herd(root=folder, seed=1, image_size=SIZE, views="photographer")


@pytest.fixture(scope="module")
def samples(herd) -> list[HerdSample]:
    return [herd.sample("Pony", index) for index in range(4)]


def test_bound_pose_is_the_mesh_at_withers_height_one(folder):
    animal = prepare(folder / "Pony.glb")
    verts, points = pose_animal(animal, PLAIN, None, 0.0)
    np.testing.assert_allclose(verts, animal.rest, atol=1e-9)
    np.testing.assert_allclose(points, animal.keypoints, atol=1e-9)
    at = dict(zip(KEYPOINTS, points, strict=True))
    assert at["withers"][1] == pytest.approx(1)
    assert verts[:, 1].min() == pytest.approx(0, abs=1e-9)
    _check_order(at)


def _check_order(at: dict[str, np.ndarray]) -> None:
    """Left is +x, the nose is in front, legs go down from elbow to paw."""
    for part in ("eye", "ear", *(f"{end}_{joint}" for end in ("front", "back") for joint in ("elbow", "knee", "paw"))):
        assert at[f"left_{part}"][0] > 0 > at[f"right_{part}"][0], part
    for side in ("left", "right"):
        for end in ("front", "back"):
            heights = [at[f"{side}_{end}_{joint}"][1] for joint in ("elbow", "knee", "paw")]
            assert heights[0] > heights[1] > heights[2] >= 0, (side, end)
            assert heights[2] < 0.15
        assert at[f"{side}_front_paw"][2] > at[f"{side}_back_paw"][2]
        assert at["nose"][2] > at[f"{side}_eye"][2] > at["withers"][2]
    assert at["withers"][2] > at["tailbase"][2]
    assert at["throat"][1] < max(at["left_eye"][1], at["left_ear"][1])
    assert at["withers"][2] < at["throat"][2] < at["nose"][2]


def test_legs_are_labelled_by_side_and_end(folder):
    animal = prepare(folder / "Pony.glb")
    for label, (side, end) in enumerate(((1, 1), (-1, 1), (1, -1), (-1, -1))):
        leg = animal.rest[animal.legs == label]
        assert len(leg) > 50
        assert (leg[:, 0] * side > -0.02).mean() > 0.99
        assert np.sign((leg[:, 2] - animal.rest[:, 2].mean()).mean()) == end
    assert (animal.rest[animal.legs == -1, 1].mean()) > animal.rest[animal.legs >= 0, 1].mean()


def test_dead_clips_are_left_out(folder):
    animal = prepare(folder / "Pony.glb")
    assert list(animal.clips) == ["Armature|Spin", "Armature|Walk"]
    rng = np.random.default_rng(0)
    drawn = [sample_moment(animal, rng) for _ in range(40)]
    assert {name for name, _ in drawn} == set(animal.clips)
    assert 0 <= min(time for _, time in drawn) < max(time for _, time in drawn) <= 1
    assert sample_moment(prepare(folder / "more" / "Still.glb"), rng) == (None, 0.0)


def test_a_clip_that_turns_on_the_spot_does_not_turn_the_trunk(folder):
    animal = prepare(folder / "Pony.glb")
    _, points = pose_animal(animal, PLAIN, "Armature|Spin", 0.3)
    moved = points - animal.keypoints
    np.testing.assert_allclose(moved, np.broadcast_to(moved.mean(0), moved.shape), atol=1e-6)  # a shift is left


def test_walking_swings_opposite_legs_and_leaves_the_trunk(folder):
    animal = prepare(folder / "Pony.glb")
    _, points = pose_animal(animal, PLAIN, "Armature|Walk", 0.0)
    moved = points - animal.keypoints
    by_name = dict(zip(KEYPOINTS, moved[:, 2], strict=True))
    assert by_name["left_front_paw"] * by_name["right_front_paw"] < 0
    assert by_name["left_front_paw"] * by_name["left_back_paw"] < 0
    assert abs(by_name["left_front_paw"]) > 0.1 > abs(by_name["withers"])


def test_build_changes_what_it_names(folder):
    animal = prepare(folder / "Pony.glb")
    wide, _ = pose_animal(animal, Build(np.array([1.2, 1, 1]), 1.0, 1.0, 1.0, np.zeros(2)), None, 0.0)
    np.testing.assert_allclose(wide, animal.rest * [1.2, 1, 1], atol=1e-9)
    fat, points = pose_animal(animal, Build(np.ones(3), 1.0, 1.0, 1.0, np.array([0.05, 0.0])), None, 0.0)
    grown = np.linalg.norm(fat - animal.rest, axis=1)
    assert grown[animal.girth[:, 0] > 0.95].min() > 0.045
    assert grown[animal.girth[:, 1] > 0.95].max() < 0.005
    big, points = pose_animal(animal, Build(np.ones(3), 1.3, 1.0, 1.0, np.zeros(2)), None, 0.0)
    reach = [
        np.linalg.norm(each[KEYPOINTS.index("nose")] - each[KEYPOINTS.index("left_ear")])
        for each in (points, animal.keypoints)
    ]
    assert reach[0] > 1.15 * reach[1]
    assert np.isfinite(big).all()


def test_samples_are_pure_functions(folder, samples):
    fresh = Herd(root=folder, seed=1, image_size=SIZE, views="photographer")
    fresh.sample("Still", 5)  # history must not matter
    again = fresh.sample("Pony", 3)
    np.testing.assert_array_equal(again.image, samples[3].image)
    np.testing.assert_array_equal(again.truth.verts, samples[3].truth.verts)
    np.testing.assert_array_equal(fresh.truth("Pony", 3).clip_from_world, samples[3].truth.clip_from_world)
    assert not np.array_equal(
        Herd(root=folder, seed=2, image_size=SIZE, views="photographer").sample("Pony", 3).image, again.image
    )


def test_individuals_differ_and_four_photos_share_one(herd):
    rest = [herd._individuals[("Pony", number)] for number in (0,)]
    herd.sample("Pony", 4)
    other = herd._individuals[("Pony", 1)]
    assert not np.array_equal(rest[0].albedo, other.albedo)
    assert not np.array_equal(rest[0].build.stretch, other.build.stretch)


def test_truth_fits_the_picture(samples):
    for sample in samples:
        truth = sample.truth
        clip = project(truth.clip_from_world, truth.verts)
        fine = 3 * SIZE
        coverage = (rasterise(clip, truth.faces, fine, fine)[0] >= 0).reshape(SIZE, 3, SIZE, 3).mean((1, 3)) >= 0.5
        mask = sample.mask > 0
        assert (mask & coverage).sum() / (mask | coverage).sum() > 0.93
        assert 0.1 < mask.mean() < 0.3
        assert np.abs(clip[:, :2] / clip[:, 3:]).max() <= 1.02
        points = project(truth.clip_from_world, truth.keypoints)
        assert np.abs(points[:, :2] / points[:, 3:]).max() <= 1.0
        assert sample.image[mask].std() > 4


@pytest.mark.parametrize("views", ["photographer", "uniform"])
def test_camera_and_angles_agree(folder, views):
    herd = Herd(root=folder, seed=0, image_size=SIZE, views=views)
    angles = []
    for index in range(40):
        truth = herd.truth("Pony", index)
        rotation = truth.camera_from_world[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        forward = rotation[:, 2]
        gap = np.degrees(np.arctan2(forward[0], forward[2])) - truth.azimuth_deg
        assert abs((gap + 180) % 360 - 180) < 4  # roll
        seen = project(truth.camera_from_world, truth.verts)
        np.testing.assert_allclose(project(truth.clip_from_world, truth.verts)[:, 3], -seen[:, 2], rtol=1e-9)
        assert -180 <= truth.azimuth_deg < 180
        angles.append(abs(truth.azimuth_deg))
    behind = np.mean(np.array(angles) > 125)
    assert (behind > 0.15) == (views == "uniform")


def test_paint_keeps_eyes_and_varies_fur(folder):
    animal = prepare(folder / "Pony.glb")
    colours, owner = base_colours(load_model(folder / "Pony.glb"), animal.refinement)
    np.testing.assert_allclose(colours, np.tile([0.2, 0.1, 0.05], (len(colours), 1)))
    assert (owner == 0).all()
    painted = [
        paint("horse", colours, animal.gloss, animal.rest, animal.normals, np.random.default_rng(i)) for i in range(3)
    ]
    for albedo in painted:
        assert 0 < albedo.min() <= albedo.max() <= 1
        assert albedo.std(0).max() > 0.003
        assert (albedo[:, 2] <= albedo[:, 1]).all()
    assert not np.array_equal(painted[0], painted[1])


def test_openness_outside_and_inside_a_box():
    """Nothing hides the sky from the corners of a box; turned inside out, its walls hide most of it."""
    outside = openness(CUBE, vertex_normals(CUBE, CUBE_FACES), CUBE_FACES)
    np.testing.assert_allclose(outside, 1)
    inward = CUBE_FACES[:, ::-1]
    assert (openness(CUBE, vertex_normals(CUBE, inward), inward) < 0.6).all()


def test_openness_of_a_floor_under_a_disc():
    """A small disc of area A at height h, parallel to the floor, hides A / (pi h^2 + A)."""
    disc = np.array([[0.01, 2.0, 0.0], [-0.01, 2.0, 0.01], [-0.01, 2.0, -0.01]])
    floor = np.zeros((3, 3))
    up = np.tile([0.0, 1.0, 0.0], (6, 1))
    for faces, sign in (([[3, 4, 5]], 1), ([[3, 5, 4]], -1)):  # one of the two faces down
        facing = sign * np.cross(disc[1] - disc[0], disc[2] - disc[0])[1]
        expected = 1 - 2e-4 / (np.pi * 4 + 2e-4) if facing < 0 else 1.0
        found = openness(np.concatenate([floor, disc]), up, np.array(faces))[0]
        assert found == pytest.approx(expected, abs=1e-7)


def test_borrowed_clips_repeat_what_the_donor_does(folder):
    """On an animal of the same proportions a borrowed clip is the original."""
    model = load_model(folder / "Pony.glb")
    bound = Skeleton(model.node_names, local_from_world(model.bind_world, model.parents), 1.0)
    clip = model.clips["Armature|Walk"]
    ours, _ = pose(model, clip.at(model.rest, 0.2))
    theirs, _ = pose(model, borrow(clip, bound, bound).at(model.rest, 0.2))
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


def test_borrowed_translations_scale(folder):
    from dataclasses import replace

    from fauna.models3d.clips import Channel

    model = load_model(folder / "Pony.glb")
    donor = Skeleton(model.node_names, local_from_world(model.bind_world, model.parents), 1.0)
    taker = replace(donor, height=2.0)
    node = model.node("Back")
    rest = donor.bound.translation[node]
    clip = Clip(
        "Bob",
        (Channel(node, "translation", "LINEAR", np.array([0.0, 1.0]), np.stack([rest, rest + [0, 1, 0]])[:, None]),),
    )
    moved = borrow(clip, donor, taker)
    np.testing.assert_allclose(moved.channels[0].at(0.0), rest)
    np.testing.assert_allclose(moved.channels[0].at(1.0), rest + [0, 2, 0])
    nameless = replace(taker, names=tuple("x" for _ in taker.names))
    assert borrow(clip, donor, nameless).channels == ()


def test_messages(folder, tmp_path):
    with pytest.raises(FaunaError, match="expects .glb files in .* got none"):
        Herd(root=tmp_path, seed=0, image_size=SIZE, views="uniform")
    herd = Herd(root=folder, seed=0, image_size=SIZE, views="uniform")
    with pytest.raises(FaunaError, match="unknown model 'Cat'; expected one of Pony, Still"):
        herd.sample("Cat", 0)
    with pytest.raises(FaunaError, match="index must not be negative, received -1"):
        herd.sample("Pony", -1)
    with pytest.raises(FaunaError, match="at least 16, received 8"):
        Herd(root=folder, seed=0, image_size=8, views="uniform")
    (tmp_path / "a").mkdir()
    for place in (tmp_path / "Pony.glb", tmp_path / "a" / "Pony.glb"):
        place.write_bytes((folder / "Pony.glb").read_bytes())
    with pytest.raises(FaunaError, match=r"got Pony.glb twice"):
        Herd(root=tmp_path, seed=0, image_size=SIZE, views="uniform")


def test_keypoints_lie_on_the_picture_and_far_legs_are_hidden_more_often(samples):
    seen = []
    for sample in samples:
        expected = sample.truth.keypoints @ sample.truth.clip_from_world[:, :3].T + sample.truth.clip_from_world[:, 3]
        pixels = (expected[:, :2] / expected[:, 3:] + 1) * 0.5 * sample.image.shape[0]
        np.testing.assert_allclose(sample.keypoints[:, :2], pixels, atol=1e-6)
        flags = sample.keypoints[:, 2]
        assert set(np.unique(flags)) <= {0.0, 1.0}
        inside = ((pixels >= 0) & (pixels < sample.image.shape[0])).all(axis=1)
        assert not flags[~inside].any()
        away = np.linalg.norm(sample.truth.keypoints - np.linalg.inv(sample.truth.camera_from_world)[:3, 3], axis=1)
        pairs = [
            (KEYPOINTS.index(f"left_{n}"), KEYPOINTS.index(f"right_{n}")) for n in ("eye", "back_elbow", "front_elbow")
        ]
        for left, right in pairs:
            near, far = (left, right) if away[left] < away[right] else (right, left)
            seen.append((flags[near], flags[far]))
    near, far = np.array(seen).mean(axis=0)
    assert near > far
