import math
from collections.abc import Iterator

import jaxtyping
import pytest
import torch
from torch.autograd import gradcheck

from fauna.errors import FaunaError
from fauna.geometry.rotations import euler_xyz_to_matrix
from fauna.geometry.skeleton import MAX_CHAIN, SkeletonOptions, rest_skeleton
from fauna.geometry.skinning import (
    bone_transforms,
    posed_bones,
    rest_frames,
    skin,
    skinning_weights,
    squared_distance_to_bones,
)
from fauna.types import Skeleton

OPTIONS = SkeletonOptions(
    body_height=0.5,
    centre_lift=0.5,
    foot_quantile=0.4,
    margin=0.2,
    foot_origin="median",
    symmetric_feet=True,
    attachment="z_nearest",
)


def mesh(batch: int, dtype=torch.float64) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    box = torch.tensor([1.6, 3.0, 4.0], dtype=dtype)
    return (torch.rand(batch, 60, 3, generator=generator, dtype=dtype) - 0.5) * box


def skeleton_of(verts: torch.Tensor, legs_attached: bool = True) -> Skeleton:
    return rest_skeleton(verts, options=OPTIONS, legs_attached=legs_attached)


def random_angles(rows: int, seed: int = 1) -> torch.Tensor:
    return torch.randn(rows, 20, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def slow_transform(skeleton: Skeleton, angles: torch.Tensor, item: int, row: int, bone: int) -> torch.Tensor:
    """Product over the chain of one bone, with 4 x 4 inverses."""
    frame = torch.eye(4, dtype=torch.float64)
    frame[:3, :3] = rest_frames(skeleton)[item, bone]
    frame[:3, 3] = skeleton.starts[item, bone]
    turn = torch.eye(4, dtype=torch.float64)
    turn[:3, :3] = euler_xyz_to_matrix(angles[row, bone])
    own = frame @ turn @ torch.linalg.inv(frame)
    parent = int(skeleton.parents[item, bone])
    return own if parent < 0 else slow_transform(skeleton, angles, item, row, parent) @ own


@pytest.mark.parametrize("legs_attached", [True, False])
@pytest.mark.parametrize("batch", [1, 3])
def test_transforms_equal_the_chain_product(batch, legs_attached):
    skeleton, angles = skeleton_of(mesh(batch), legs_attached), random_angles(3)
    transforms = bone_transforms(skeleton, angles)
    for row in range(3):
        for bone in range(20):
            expected = slow_transform(skeleton, angles, min(row, batch - 1), row, bone)
            torch.testing.assert_close(transforms[row, bone], expected)


def test_rest_frames_are_rotations_along_the_bones():
    skeleton = skeleton_of(mesh(2))
    frames = rest_frames(skeleton)
    torch.testing.assert_close(frames @ frames.transpose(-1, -2), torch.eye(3, dtype=torch.float64).expand_as(frames))
    bones = torch.nn.functional.normalize(skeleton.ends - skeleton.starts, dim=-1)
    torch.testing.assert_close(frames[..., 2], bones)


@pytest.mark.parametrize("bone", [(1.0, 0.0, 0.0), (-2.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_degenerate_bones_have_a_frame(bone):
    ends = torch.tensor(bone, dtype=torch.float64).reshape(1, 1, 3)
    frame = rest_frames(Skeleton(torch.zeros_like(ends), ends, torch.tensor([[-1]])))[0, 0]
    torch.testing.assert_close(frame @ frame.T, torch.eye(3, dtype=torch.float64))
    torch.testing.assert_close(torch.linalg.det(frame), torch.tensor(1.0, dtype=torch.float64))


def test_frames_of_spine_and_leg_follow_the_conventions():
    starts = torch.zeros(1, 2, 3)
    ends = torch.tensor([[[0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]])
    frames = rest_frames(Skeleton(starts, ends, torch.tensor([[-1, -1]])))[0]
    torch.testing.assert_close(frames[0], torch.eye(3))
    torch.testing.assert_close(frames[1, :, 0], torch.tensor([1.0, 0.0, 0.0]))
    torch.testing.assert_close(frames[1, :, 1], torch.tensor([0.0, 0.0, 1.0]))


def test_zero_angles_are_the_identity():
    verts = mesh(2)
    skeleton = skeleton_of(verts)
    transforms = bone_transforms(skeleton, torch.zeros(2, 20, 3, dtype=torch.float64))
    weights = skinning_weights(verts, skeleton, temperature=0.05, distance="euclidean")
    torch.testing.assert_close(skin(verts, weights, transforms), verts)
    torch.testing.assert_close(posed_bones(skeleton, transforms), (skeleton.starts, skeleton.ends))


@pytest.mark.parametrize("legs_attached", [True, False])
def test_a_rotation_moves_exactly_the_descendants(legs_attached):
    skeleton = skeleton_of(mesh(1), legs_attached)
    parents = skeleton.parents[0].tolist()
    for bone in range(20):
        angles = torch.zeros(1, 20, 3, dtype=torch.float64)
        angles[0, bone, 0] = 0.5
        moved = bone_transforms(skeleton, angles)[0] - torch.eye(4, dtype=torch.float64)
        moved = moved.abs().amax(dim=(1, 2)) > 1e-9
        for other in range(20):
            ancestor = other
            while ancestor not in (bone, -1):
                ancestor = parents[ancestor]
            assert bool(moved[other]) == (ancestor == bone)
    attached = [leg for leg in range(4) if parents[10 + 3 * leg] >= 0]
    assert attached == ([0, 1, 2, 3] if legs_attached else [])


def test_posed_chains_stay_connected_and_bones_keep_their_length():
    skeleton = skeleton_of(mesh(1))
    starts, ends = posed_bones(skeleton, bone_transforms(skeleton, random_angles(4)))
    for bone, parent in enumerate(skeleton.parents[0].tolist()):
        if parent >= 0:
            torch.testing.assert_close(starts[:, bone], ends[:, parent])
    rest_length = (skeleton.ends - skeleton.starts).norm(dim=-1)
    torch.testing.assert_close((ends - starts).norm(dim=-1), rest_length.expand(4, -1))


def test_a_spine_swing_bends_in_the_sagittal_plane():
    skeleton = skeleton_of(mesh(1))
    angles = torch.zeros(1, 20, 3, dtype=torch.float64)
    angles[0, 3, 0] = 0.4
    _, ends = posed_bones(skeleton, bone_transforms(skeleton, angles))
    torch.testing.assert_close(ends[0, 0, 0], torch.tensor(0.0, dtype=torch.float64))
    assert (ends[0, 0] - skeleton.ends[0, 0]).norm() > 0.1


def slow_distance(point: torch.Tensor, start: torch.Tensor, end: torch.Tensor) -> float:
    """Minimum over the segment by dense sampling."""
    steps = torch.linspace(0, 1, 20001, dtype=torch.float64)[:, None]
    return float(((start + steps * (end - start) - point).square().sum(-1)).min())


def test_distances_equal_sampled_segments():
    verts = mesh(1)[:, :6]
    skeleton = skeleton_of(mesh(1))
    found = squared_distance_to_bones(verts, skeleton)
    for bone in range(20):
        for vert in range(6):
            expected = slow_distance(verts[0, vert], skeleton.starts[0, bone], skeleton.ends[0, bone])
            assert float(found[0, bone, vert]) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("distance", ["euclidean", "squared"])
def test_weights_are_the_softmax_of_distances(distance):
    verts = mesh(2)
    skeleton = skeleton_of(verts)
    squared = squared_distance_to_bones(verts, skeleton)
    d = (squared + 1e-6).sqrt() if distance == "euclidean" else squared
    weights = skinning_weights(verts, skeleton, temperature=0.3, distance=distance)
    torch.testing.assert_close(weights, torch.softmax(-d.transpose(1, 2) / 0.3, dim=-1))
    assert not weights.requires_grad
    single = skinning_weights(verts.float(), skeleton_of(verts.float()), temperature=0.3, distance=distance)
    torch.testing.assert_close(single.double(), weights, atol=1e-5, rtol=0)


def test_float32_weights_are_accurate_at_the_sharp_temperature():
    verts = mesh(1)
    skeleton = skeleton_of(verts)
    rough = Skeleton(skeleton.starts.float(), skeleton.ends.float(), skeleton.parents)
    exact = skinning_weights(verts, skeleton, temperature=0.05, distance="euclidean")
    single = skinning_weights(verts.float(), rough, temperature=0.05, distance="euclidean")
    torch.testing.assert_close(single.double(), exact, atol=1e-3, rtol=0)


@pytest.mark.parametrize("shared", ["verts", "weights", "both", "none"])
def test_skin_is_the_weighted_sum_of_rigid_motions(shared):
    rows = 3
    verts = mesh(1 if shared in ("verts", "both") else rows)
    skeleton = skeleton_of(verts)
    weights = skinning_weights(verts, skeleton, temperature=0.3, distance="euclidean")
    if shared == "weights":
        weights = weights[:1]
    transforms = bone_transforms(skeleton, random_angles(rows))
    out = skin(verts, weights, transforms)
    for row in range(rows):
        v, w = verts[min(row, len(verts) - 1)], weights[min(row, len(weights) - 1)]
        homogeneous = torch.cat((v, torch.ones_like(v[:, :1])), dim=1)
        expected = sum(w[:, bone, None] * (homogeneous @ transforms[row, bone].T)[:, :3] for bone in range(20))
        torch.testing.assert_close(out[row], expected)


def test_one_bone_with_all_weight_turns_rigidly_about_its_start():
    skeleton = Skeleton(torch.tensor([[[0.0, 1.0, 0.0]]]), torch.tensor([[[0.0, 0.0, 0.0]]]), torch.tensor([[-1]]))
    transforms = bone_transforms(skeleton, torch.tensor([[[math.pi / 2, 0.0, 0.0]]]))
    moved = skin(torch.tensor([[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]), torch.ones(1, 2, 1), transforms)
    torch.testing.assert_close(moved[0, 1], torch.tensor([0.0, 1.0, 0.0]))
    torch.testing.assert_close(moved[0, 0].abs(), torch.tensor([0.0, 1.0, 1.0]), atol=1e-6, rtol=0)


def test_rows_of_a_photo_share_its_mesh_weights_and_bones():
    verts = mesh(2)
    skeleton, angles = skeleton_of(verts), random_angles(6)
    photo = torch.tensor([0, 0, 0, 1, 1, 1])
    weights = skinning_weights(verts, skeleton, temperature=0.3, distance="euclidean")
    transforms = bone_transforms(skeleton, angles)
    torch.testing.assert_close(transforms, bone_transforms(skeleton.rows(photo), angles))
    torch.testing.assert_close(posed_bones(skeleton, transforms), posed_bones(skeleton.rows(photo), transforms))
    torch.testing.assert_close(skin(verts, weights, transforms), skin(verts[photo], weights[photo], transforms))
    with pytest.raises(ValueError, match="5 rows of 2 photos"):
        skin(verts, weights, transforms[:5])


@pytest.mark.parametrize("instances", [1, 2])
@pytest.mark.parametrize("shared_weights", [True, False])
def test_gradients_of_shared_and_own_meshes(instances, shared_weights):
    verts = mesh(instances)[:, :5].requires_grad_()
    skeleton = skeleton_of(mesh(instances))
    weights = skinning_weights(verts.detach(), skeleton, temperature=0.3, distance="euclidean")
    transforms = bone_transforms(skeleton, random_angles(4)).requires_grad_()
    weights = weights[:1] if shared_weights else weights
    assert gradcheck(lambda v, t: skin(v, weights, t), (verts, transforms))


def test_blocks_of_vertices_change_nothing(monkeypatch):
    verts = mesh(2).requires_grad_()
    skeleton, angles = skeleton_of(verts), random_angles(4).requires_grad_()

    def results():
        weights = skinning_weights(verts, skeleton, temperature=0.3, distance="euclidean")
        out = skin(verts, weights, bone_transforms(skeleton, angles))
        return weights, out, *torch.autograd.grad((out * out.detach().cos()).sum(), (verts, angles))

    whole = results()
    monkeypatch.setattr("fauna.geometry.blend._CPU_BLOCK", 1)
    monkeypatch.setattr("fauna.geometry.blend._CPU_VERTS", 7)  # 60 vertices: nine blocks, the last one smaller
    for found, expected in zip(results(), whole, strict=True):
        torch.testing.assert_close(found, expected)


def test_longest_chain_is_that_of_the_bone_tree():
    parents = skeleton_of(mesh(1)).parents[0].tolist()

    def chain(bone: int) -> int:
        return 0 if bone < 0 else 1 + chain(parents[bone])

    assert max(map(chain, range(20))) <= MAX_CHAIN
    tallest = Skeleton(
        torch.zeros(1, 20, 3), torch.ones(1, 20, 3), torch.tensor([[-1, *range(MAX_CHAIN - 1)] + [-1] * 13])
    )
    angles = random_angles(1).float()
    expected = torch.eye(4)
    for bone in range(MAX_CHAIN):  # of one bone after the other
        alone = torch.zeros_like(angles)
        alone[:, bone] = angles[:, bone]
        expected = expected @ bone_transforms(tallest, alone)[0, bone]
    torch.testing.assert_close(bone_transforms(tallest, angles)[0, MAX_CHAIN - 1], expected, atol=1e-5, rtol=1e-4)


def test_gradients():
    verts = mesh(2)[:, :5].requires_grad_()
    skeleton = skeleton_of(mesh(2))
    weights = skinning_weights(verts.detach(), skeleton, temperature=0.3, distance="euclidean")
    angles = random_angles(2).requires_grad_()
    assert gradcheck(lambda v, a: skin(v, weights, bone_transforms(skeleton, a)), (verts, angles), fast_mode=True)


def test_bitwise_repeatable_in_deterministic_mode():
    torch.use_deterministic_algorithms(True)
    try:
        results = []
        for _ in range(2):
            verts = mesh(1, torch.float32).requires_grad_()
            angles = random_angles(6).float().requires_grad_()
            skeleton = skeleton_of(verts)
            weights = skinning_weights(verts, skeleton, temperature=0.05, distance="euclidean")
            out = skin(verts, weights, bone_transforms(skeleton, angles))
            results.append((out, *torch.autograd.grad(out.square().sum(), (verts, angles))))
    finally:
        torch.use_deterministic_algorithms(False)
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


@pytest.fixture
def unchecked() -> Iterator[None]:
    """Values of a wrong type reach the code's own validation, as they do outside of tests."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


def test_bad_options(unchecked):
    verts = mesh(1)
    with pytest.raises(FaunaError, match="euclidean or squared"):
        skinning_weights(verts, skeleton_of(verts), temperature=0.05, distance="manhattan")  # type: ignore[arg-type]
    with pytest.raises(FaunaError, match="skin_temperature must be > 0"):
        skinning_weights(verts, skeleton_of(verts), temperature=0.0, distance="squared")
