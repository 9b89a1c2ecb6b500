"""Every known model, where the files are at hand: geometry against trimesh, keypoints in their order, clips that keep it."""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fauna.data.truth import LEGS
from fauna.models3d.animal import Animal, prepare
from fauna.models3d.catalogue import CATALOGUE
from fauna.models3d.herd import model_files
from fauna.models3d.load import load_model
from fauna.models3d.posing import Build, pose_animal
from fauna.zoo.body import KEYPOINTS

PLAIN = Build(np.ones(3), 1.0, 1.0, 1.0, np.zeros(2))
ONE_OF_EACH_RIG = ("Stag", "Wolf", "Cow_Farm_A", "Pig_Farm_A", "Pug_Farm_A", "fox-dog", "horse-animations")


@pytest.fixture(scope="module")
def files() -> dict[str, Path]:
    root = Path(os.environ.get("FAUNA_TEST_DATA", "")) / "models3d"
    if "FAUNA_TEST_DATA" not in os.environ or not root.is_dir():
        pytest.skip("needs FAUNA_TEST_DATA, a folder with models3d/, which is not part of the project")
    return model_files(root)


@pytest.fixture(scope="module")
def animals(files) -> dict[str, Animal]:
    return {name: prepare(files[name]) for name in ONE_OF_EACH_RIG}


def test_all_known_files_are_there_and_belong_together(files):
    assert set(CATALOGUE) <= set(files)
    for name, entry in CATALOGUE.items():
        joints = set(load_model(files[name]).node_names)
        assert entry.rig.joint_names() <= joints, name
        assert not entry.donor or entry.donor in CATALOGUE
        assert not entry.twin or CATALOGUE[entry.twin].family == entry.family


@pytest.mark.parametrize("name", ["Horse", "Pug_Farm_A", "fox-panda"])
def test_stored_geometry_against_trimesh(files, name):
    model = load_model(files[name])
    scene = trimesh.load(files[name], process=False, force="scene")
    theirs = np.concatenate([np.asarray(mesh.vertices) for mesh in scene.geometry.values()])
    count = sum(len(mesh.faces) for mesh in scene.geometry.values())
    assert len(model.faces) == count
    key = np.unique(theirs.round(5), axis=0)
    np.testing.assert_allclose(np.unique(model.verts.round(5), axis=0), key, atol=2e-5)


def test_keypoints_of_every_rig(animals):
    for name, animal in animals.items():
        at = dict(zip(KEYPOINTS, animal.keypoints, strict=True))
        for part in ("eye", "ear", *(f"{end}_{j}" for end in ("front", "back") for j in ("elbow", "knee", "paw"))):
            left, right = at[f"left_{part}"], at[f"right_{part}"]
            assert left[0] > 0 > right[0], (name, part)
            np.testing.assert_allclose(left, right * [-1, 1, 1], atol=0.06, err_msg=f"{name} {part}")
        for end in ("front", "back"):
            heights = [at[f"left_{end}_{joint}"][1] for joint in ("elbow", "knee", "paw")]
            assert heights[0] > heights[1] > heights[2] > -0.01, (name, end)
            assert heights[2] < 0.1, (name, end)
        assert at["nose"][2] > at["left_eye"][2] > at["left_ear"][2] - 0.05 > at["withers"][2] - 0.05, name
        assert at["left_ear"][1] > at["left_eye"][1] - 0.05, name
        assert at["withers"][2] > at["left_back_elbow"][2] > at["tailbase"][2], name
        assert at["withers"][2] < at["throat"][2] < at["nose"][2], name
        assert abs(at["withers"][2] - at["left_front_elbow"][2]) < 0.25, name
        length = np.ptp(animal.rest[:, 2])
        for keypoint, place in at.items():
            away = np.linalg.norm(animal.rest - place, axis=1).min()
            assert away < 0.08 * length, (name, keypoint)


def test_paws_and_tail_of_a_rig_without_joints_there_can_be_seen(animals):
    """The pug's paws lie at its toes and above the sole, its tail base where the body has become as narrow as a tail."""
    pug = animals["Pug_Farm_A"]
    at = dict(zip(KEYPOINTS, pug.keypoints, strict=True))
    for leg, name in enumerate(LEGS):
        foot = pug.rest[(pug.legs == leg) & (pug.rest[:, 1] < 0.08)]
        along = (at[f"{name}_paw"][2] - foot[:, 2].min()) / np.ptp(foot[:, 2])
        assert along > 0.75, name
        assert at[f"{name}_paw"][1] - foot[:, 1].min() > 0.03, name
    _, height, depth = at["tailbase"]
    beside = pug.rest[(np.abs(pug.rest[:, 1] - height) < 0.04) & (np.abs(pug.rest[:, 2] - depth) < 0.03)]
    assert len(beside) > 20
    assert np.abs(beside[:, 0]).max() < 0.1


def test_clips_move_limbs_without_tearing(animals):
    """Edges of the fine mesh stay within a factor of four, the feet near the ground; dead ones are left out."""
    for name, animal in animals.items():
        assert animal.clips, name
        assert not any("death" in clip.lower() for clip in animal.clips), name
        edges = animal.refinement.faces[:, [0, 1]]
        before = np.linalg.norm(animal.rest[edges[:, 0]] - animal.rest[edges[:, 1]], axis=1)
        for clip in animal.clips:
            verts, points = pose_animal(animal, PLAIN, clip, 0.4 * animal.clips[clip].duration)
            after = np.linalg.norm(verts[edges[:, 0]] - verts[edges[:, 1]], axis=1)
            assert (after > 4 * before + 0.02).mean() < 0.002, (name, clip)
            assert np.ptp(verts[:, 1]) < 1.6 * max(np.ptp(animal.rest[:, 1]), np.ptp(animal.rest[:, 2])), (name, clip)
            assert np.isfinite(points).all()


def test_legs_are_found_on_all_rigs(animals):
    for name, animal in animals.items():
        for leg in range(4):
            chosen = animal.rest[animal.legs == leg]
            assert len(chosen) > 100, (name, leg)
            assert ((chosen[:, 0] > -0.03) if leg % 2 == 0 else (chosen[:, 0] < 0.03)).mean() > 0.98, (name, leg)
        front, back = (animal.rest[np.isin(animal.legs, pair), 2].mean() for pair in ((0, 1), (2, 3)))
        assert front > back + 0.4, name
