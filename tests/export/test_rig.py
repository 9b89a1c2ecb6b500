"""Weights, frames and the photo's pose against the project's own skinning."""

import json

import numpy as np
import pytest
import torch

from fauna.errors import FaunaError
from fauna.export import joints
from fauna.export.influences import strongest_influences
from fauna.export.joints import BONE_OF_JOINT, JOINT, JOINT_NAMES, JOINT_OF_BONE, LEGS, NUM_JOINTS
from fauna.export.rig import RestAnimal, rig_animal
from fauna.geometry.skeleton import LEG_SIDE_X, LEG_SIDE_Z, NUM_BONES
from fauna.geometry.skinning import bone_transforms, posed_bones, skinning_weights
from fauna.types import Skeleton
from tests.export.objects import RIG, animal, rest_animal


def test_every_bone_of_the_model_is_one_joint():
    assert sorted(bone for bone in BONE_OF_JOINT if bone is not None) == list(range(NUM_BONES))
    assert NUM_JOINTS == NUM_BONES + 1 == len(set(JOINT_NAMES))
    assert [JOINT_NAMES[JOINT_OF_BONE[bone]] for bone in (0, 3, 4, 7)] == ["head", "spine_front", "tail", "spine_rear"]


def test_legs_are_named_as_they_stand():
    """The animal faces +z with y up, so its left is +x."""
    for leg in range(4):
        end, side = ("front" if LEG_SIDE_Z[leg] > 0 else "hind"), ("left" if LEG_SIDE_X[leg] > 0 else "right")
        names = [JOINT_NAMES[JOINT_OF_BONE[8 + 3 * leg + part]] for part in range(3)]
        assert names == [f"{end}_{side}_{part}" for part in ("foot", "lower", "upper")]
    rigged = animal(0)
    for leg in LEGS:
        foot = rigged.ends[leg.joints[2]]
        assert (foot[0] > 0) == leg.name.endswith("left")
        assert (foot[2] > 0) == leg.front


def test_parents_come_first_in_the_document_too():
    document = json.loads((joints.files("fauna.export") / "skeleton.json").read_text())
    seen = {None, "*"}
    for joint in document["joints"]:
        assert joint["parent"] in seen
        seen.add(joint["name"])


def test_a_leg_hangs_where_the_model_hangs_it():
    for seed in range(2):
        rest = rest_animal(seed)
        rigged = rig_animal(RIG, rest, name="x", back_height=1.0)
        for leg in LEGS:
            upper = leg.joints[0]
            bone = BONE_OF_JOINT[upper]
            assert bone is not None
            assert rigged.parents[upper] == JOINT_OF_BONE[int(rest.skeleton.parents[0, bone])]
        loose = animal(seed, attached=False)
        assert [loose.parents[leg.joints[0]] for leg in LEGS] == [0, 0, 0, 0]


def test_axes_are_as_documented():
    rigged = animal(3)
    along = rigged.ends - rigged.starts
    for joint in range(1, NUM_JOINTS):
        unit = along[joint] / np.linalg.norm(along[joint])
        np.testing.assert_allclose(rigged.frames[joint, :, 1], unit, atol=1e-9)
        assert rigged.frames[joint, 0, 0] > 0.5  # x towards the left
        np.testing.assert_allclose(np.linalg.det(rigged.frames[joint]), 1.0)
    np.testing.assert_array_equal(rigged.frames[JOINT["root"]], np.eye(3))


@pytest.mark.parametrize("attached", [True, False])
def test_joints_move_as_the_models_bones(attached):
    rest = rest_animal(1, attached=attached)
    rigged = rig_animal(RIG, rest, name="x", back_height=1.4)
    starts, ends = posed_bones(rest.skeleton, bone_transforms(rest.skeleton, rest.angles[None]))
    world = rigged.joint_transforms(rigged.photo)
    order = list(JOINT_OF_BONE)
    np.testing.assert_allclose(rigged.to_world(world[order, :3, 3]), starts[0].numpy(), atol=1e-9)
    length = np.linalg.norm(rigged.ends - rigged.starts, axis=1)
    tips = world[:, :3, 3] + length[:, None] * world[:, :3, 1]
    np.testing.assert_allclose(rigged.to_world(tips[order]), ends[0].numpy(), atol=1e-9)


def test_the_photos_pose_is_the_models_mesh_where_four_weights_are_all():
    rest = rest_animal(2)
    rigged = rig_animal(RIG, rest, name="x", back_height=1.0)
    weights = skinning_weights(rest.verts[None], rest.skeleton, temperature=0.05, distance="euclidean")[0]
    lost = 1.0 - weights.topk(4, dim=1).values.sum(dim=1)
    distance = np.linalg.norm(rigged.to_world(rigged.pose(rigged.photo)) - rest.posed.numpy(), axis=1)
    exact = (lost < 1e-6).numpy()
    assert exact.mean() > 0.05
    assert distance[exact].max() < 1e-4
    share = distance * rigged.metres_per_unit / rigged.body_length
    assert rigged.skin_error_max == pytest.approx(share.max())
    assert rigged.skin_error_mean == pytest.approx(share.mean())
    assert rigged.skin_error_mean < 0.01


def test_all_weights_would_be_exact(monkeypatch):
    """The frame, the names and the hierarchy lose nothing: with all twenty weights the error is rounding."""
    rest = rest_animal(4)
    rigged = rig_animal(RIG, rest, name="x", back_height=1.0)
    weights = skinning_weights(rest.verts[None], rest.skeleton, temperature=0.05, distance="euclidean")[0].numpy()
    rest_places = np.linalg.inv(rigged.joint_transforms(np.tile([0.0, 0, 0, 1], (NUM_JOINTS, 1))))
    moved = (rigged.joint_transforms(rigged.photo) @ rest_places)[list(JOINT_OF_BONE)]
    blended = np.einsum("vb,bjk->vjk", weights, moved)
    posed = np.einsum("vjk,vk->vj", blended[:, :3, :3], rigged.vertices) + blended[:, :3, 3]
    np.testing.assert_allclose(rigged.to_world(posed), rest.posed.numpy(), atol=1e-9)


def test_the_stated_scale():
    small, large = animal(5, back_height=0.4), animal(5, back_height=1.6)
    np.testing.assert_allclose(large.vertices, 4 * small.vertices)
    np.testing.assert_allclose(large.starts[JOINT["root"]], [0.0, 1.6, 0.0], atol=1e-12)
    assert large.vertices[:, 1].min() == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(large.to_world(large.vertices), rest_animal(5).verts.numpy(), atol=1e-12)


def test_influences_against_sorting():
    generator = np.random.default_rng(0)
    weights = generator.dirichlet(np.full(20, 0.1), size=200)
    names = generator.permutation(20) + 1
    found, kept = strongest_influences(weights, names)
    np.testing.assert_allclose(kept.sum(axis=1), 1.0)
    assert (found[kept == 0] == 0).all()
    assert (np.diff(kept, axis=1) <= 0).all()
    for row in range(200):
        best = sorted(range(20), key=lambda bone, row=row: -weights[row, bone])[:4]
        share = sum(weights[row, bone] for bone in best)
        for place, bone in enumerate(best):
            if weights[row, bone] > 2**-16:
                assert found[row, place] == names[bone]
                assert kept[row, place] == pytest.approx(weights[row, bone] / share, rel=1e-3)


def test_a_vertex_with_one_joint_keeps_it_alone():
    found, kept = strongest_influences(np.eye(6), np.arange(6) + 3)
    np.testing.assert_array_equal(kept, np.tile([1.0, 0, 0, 0], (6, 1)))
    np.testing.assert_array_equal(found, [[bone + 3, 0, 0, 0] for bone in range(6)])


@pytest.mark.parametrize("height", [0.0, -1.0, float("nan"), float("inf")])
def test_a_height_that_is_none(height):
    with pytest.raises(FaunaError, match="back_height: expected metres above 0"):
        rig_animal(RIG, rest_animal(0), name="x", back_height=height)


def test_a_mesh_that_is_none():
    rest = rest_animal(0)
    empty = RestAnimal(rest.verts, rest.faces[:0], rest.skeleton, rest.angles, rest.posed)
    with pytest.raises(FaunaError, match="expected a finite surface"):
        rig_animal(RIG, empty, name="x", back_height=1.0)
    flat = RestAnimal(rest.verts * torch.tensor([1.0, 0, 1]), rest.faces, Skeleton(
        rest.skeleton.starts * torch.tensor([1.0, 0, 1]), rest.skeleton.ends, rest.skeleton.parents), rest.angles, rest.posed)  # fmt: skip
    with pytest.raises(FaunaError, match="a back above the ground"):
        rig_animal(RIG, flat, name="x", back_height=1.0)
