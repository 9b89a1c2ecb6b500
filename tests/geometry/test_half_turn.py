"""The turn of bones and angles, against what it is meant to do to a posed mesh."""

import dataclasses

import pytest
import torch

from fauna.geometry.half_turn import OTHER_END, half_turn, other_end, turn_angles, turn_skeleton
from fauna.geometry.skeleton import LEG_SIDE_X, LEG_SIDE_Z, NUM_BONES, rest_skeleton
from fauna.geometry.skinning import bone_transforms, skin, skinning_weights
from fauna.types import Skeleton
from tests.geometry.test_skeleton import OPTIONS

TURN = torch.diag(torch.tensor([-1.0, 1.0, -1.0], dtype=torch.float64))


def body() -> torch.Tensor:
    """(1, vert, 3) two meshes' worth of points: a trunk with four legs, longer in front than behind, in float64."""
    generator = torch.Generator().manual_seed(0)
    trunk = torch.rand(600, 3, generator=generator, dtype=torch.float64) * 2 - 1
    trunk = trunk * torch.tensor([0.4, 0.3, 1.2]) + torch.tensor([0.0, 0.0, 0.3])
    legs = [
        torch.rand(80, 3, generator=generator, dtype=torch.float64) * torch.tensor([0.1, 1.0, 0.1])
        + torch.tensor([0.3 * x - 0.05, -1.2, 0.8 * z + (0.25 if z > 0 else 0.1)])
        for x, z in zip(LEG_SIDE_X, LEG_SIDE_Z, strict=True)
    ]
    return torch.cat((trunk, *legs))[None]


def bones(verts: torch.Tensor, *, legs_attached: bool = True) -> Skeleton:
    return rest_skeleton(verts, options=OPTIONS, legs_attached=legs_attached)


def test_points_turn_by_a_rotation_of_half_a_turn():
    points = torch.randn(5, 3, dtype=torch.float64)
    assert torch.equal(half_turn(points), points @ TURN.T)
    assert torch.linalg.det(TURN) == 1
    assert torch.equal(half_turn(half_turn(points)), points)
    assert half_turn(points, False) is points


def test_names_change_ends_and_sides():
    """docs/conventions.md, section "Skeleton", written out."""
    expected = {0: 4, 3: 7, 4: 0, 7: 3, 8: 14, 10: 16, 11: 17, 14: 8, 19: 13}
    assert all(OTHER_END[bone] == other for bone, other in expected.items())
    assert [OTHER_END[OTHER_END[bone]] for bone in range(NUM_BONES)] == list(range(NUM_BONES))


@pytest.mark.parametrize("legs_attached", [True, False])
def test_turned_bones_lie_where_their_names_say(legs_attached):
    turned = turn_skeleton(bones(body(), legs_attached=legs_attached))
    z = turned.ends[0, :, 2]
    assert (z[:3] > z[4:7]).all()
    feet = turned.ends[0, 8::3]
    assert torch.equal(feet[:, 0].sign(), torch.tensor(LEG_SIDE_X, dtype=feet.dtype))
    assert (feet[[0, 3], 2] > feet[[1, 2], 2] + 1).all()
    for bone, parent in enumerate(turned.parents[0].tolist()):
        if parent >= 0:
            torch.testing.assert_close(turned.starts[0, bone], turned.ends[0, parent])
    roots = {3, 7} if legs_attached else {3, 7, 10, 13, 16, 19}
    assert {bone for bone, parent in enumerate(turned.parents[0].tolist()) if parent < 0} == roots


def test_turning_bones_twice_changes_nothing():
    found = bones(body())
    again = turn_skeleton(turn_skeleton(found))
    for field in dataclasses.fields(Skeleton):
        assert torch.equal(getattr(again, field.name), getattr(found, field.name))


@pytest.mark.parametrize("legs_attached", [True, False])
def test_turned_angles_move_the_turned_mesh_alike(legs_attached):
    verts, angles = body(), torch.randn(3, NUM_BONES, 3, dtype=torch.float64) * 0.5
    skeleton = bones(verts, legs_attached=legs_attached)
    turned = turn_skeleton(skeleton)

    def posed(points, rig, pose):
        weights = skinning_weights(points, rig, temperature=0.05, distance="euclidean")
        return skin(points, weights, bone_transforms(rig, pose))

    expected = half_turn(posed(verts, skeleton, angles))
    torch.testing.assert_close(posed(half_turn(verts), turned, turn_angles(angles)), expected, rtol=0, atol=1e-9)
    assert (posed(half_turn(verts), turned, other_end(angles)) - expected).abs().max() > 0.1
    assert torch.equal(turn_angles(turn_angles(angles)), angles)
