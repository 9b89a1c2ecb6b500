import dataclasses
from collections.abc import Iterator

import jaxtyping
import pytest
import torch

from fauna.errors import FaunaError
from fauna.geometry.skeleton import SkeletonOptions, masked_quantiles, rest_skeleton
from fauna.types import Skeleton

OPTIONS = SkeletonOptions(
    body_height=0.5,
    centre_lift=0.5,
    foot_quantile=0.4,
    margin=0.2,
    foot_origin="median",
    symmetric_feet=False,
    attachment="z_nearest",
)


def quadruped(seed: int, legs=(1.2, 1.2, 1.2, 1.2), length: float = 2.0) -> torch.Tensor:
    """Random points of an ellipsoidal body and four cylindrical legs, 900 vertices."""
    generator = torch.Generator().manual_seed(seed)
    body = torch.nn.functional.normalize(torch.randn(500, 3, generator=generator), dim=-1)
    parts = [body * torch.tensor([0.6, 0.6, length])]
    for (x, z), height in zip(((0.4, 1.4), (0.4, -1.3), (-0.4, -1.3), (-0.4, 1.4)), legs, strict=True):
        cloud = torch.rand(100, 3, generator=generator) * torch.tensor([0.2, height, 0.2])
        parts.append(cloud + torch.tensor([x - 0.1, -0.4 - height, z - 0.1]))
    return torch.cat(parts)


def rest(verts: torch.Tensor, *, legs_attached: bool = True, **changes) -> Skeleton:
    return rest_skeleton(verts, options=dataclasses.replace(OPTIONS, **changes), legs_attached=legs_attached)


def mix(a, b, t: float):
    """Point between two points."""
    return tuple((1 - t) * u + t * v for u, v in zip(a, b, strict=True))


def quantile(values: list[float], q: float) -> float:
    """Interpolated quantile of a list."""
    return float(torch.quantile(torch.tensor(values), q))


def reference_skeleton(verts: torch.Tensor, legs_attached: bool, origin: str):
    """The heuristic, one vertex and one leg at a time."""
    points = [tuple(map(float, vert)) for vert in verts]
    mean = [sum(p[axis] for p in points) / len(points) for axis in range(3)]
    body = [p for p in points if p[1] > mean[1] - 0.5]
    front, rear = max(body, key=lambda p: p[2]), min(body, key=lambda p: p[2])
    knots = [(0.0, *front[1:]), (0.0, mean[1] + 0.5, mean[2]), (0.0, *rear[1:])]
    spine = [mix(knots[0], knots[1], i / 4) for i in range(5)] + [mix(knots[1], knots[2], i / 4) for i in range(1, 5)]
    bones = [(spine[i + 1], spine[i]) for i in range(4)] + [(spine[i - 1], spine[i]) for i in (8, 7, 6, 5)]
    parents = [1, 2, 3, -1, 5, 6, 7, -1]
    level = quantile([p[1] for p in points], 0.4)
    low = [p for p in points if p[1] <= level]
    middle = {"median": lambda values: quantile(values, 0.5), "mean": lambda values: sum(values) / len(values)}[origin]
    x0, z0 = (middle([p[axis] for p in low]) for axis in (0, 2))
    mx, mz = (0.2 * (quantile([p[a] for p in low], 0.95) - quantile([p[a] for p in low], 0.05)) for a in (0, 2))
    tests = (
        lambda p: p[0] - x0 > mx and p[2] - z0 > mz,
        lambda p: p[0] - x0 > mx and p[2] < z0,
        lambda p: p[0] - x0 < -mx and p[2] < z0,
        lambda p: p[0] - x0 < -mx and p[2] - z0 > mz,
    )
    hips: list[int] = []
    for leg, test in enumerate(tests):
        foot = min((p for p in points if test(p)), key=lambda p: p[1])
        nearest = min(range(8), key=lambda b: abs(bones[b][1][2] - foot[2]))
        hips.append(nearest if leg < 2 else hips[3 - leg])
        joints = [mix(foot, bones[hips[leg]][1], i / 3) for i in range(4)]
        bones += [(joints[i + 1], joints[i]) for i in range(3)]
        parents += [8 + 3 * leg + 1, 8 + 3 * leg + 2, hips[leg] if legs_attached else -1]
    return torch.tensor([b[0] for b in bones]), torch.tensor([b[1] for b in bones]), torch.tensor(parents)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("legs_attached", [True, False])
@pytest.mark.parametrize("origin", ["median", "mean"])
def test_equals_the_loop(seed, legs_attached, origin):
    verts = quadruped(seed, legs=(1.0, 1.1, 1.2, 1.3))
    skeleton = rest(verts[None], legs_attached=legs_attached, foot_origin=origin)
    starts, ends, parents = reference_skeleton(verts, legs_attached, origin)
    torch.testing.assert_close(skeleton.starts[0], starts, atol=1e-4, rtol=0)
    torch.testing.assert_close(skeleton.ends[0], ends, atol=1e-4, rtol=0)
    assert torch.equal(skeleton.parents[0], parents)


@pytest.mark.parametrize("symmetric", [True, False])
def test_items_of_a_batch_do_not_influence_each_other(symmetric):
    verts = torch.stack([quadruped(seed, length=1.6 + 0.3 * seed) for seed in range(4)])
    order = torch.tensor([2, 0, 3, 1])
    whole = rest(verts, symmetric_feet=symmetric)
    permuted = rest(verts[order], symmetric_feet=symmetric)
    assert len({tuple(row.tolist()) for row in whole.parents}) > 1  # else the test could not see a shared attachment
    for name in ("starts", "ends", "parents"):
        assert torch.equal(getattr(whole, name)[order], getattr(permuted, name))
    alone = rest(verts[1:2], symmetric_feet=symmetric)
    assert torch.equal(alone.ends[0], whole.ends[1])


def test_feet_are_on_the_ground_in_their_quadrants_and_farthest_from_the_body():
    skeleton = rest(quadruped(0)[None])
    feet = skeleton.ends[0, 8::3]
    assert torch.equal(feet[:, 0].sign(), torch.tensor([1.0, 1.0, -1.0, -1.0]))
    assert torch.equal(feet[:, 2].sign(), torch.tensor([1.0, -1.0, -1.0, 1.0]))
    assert (feet[:, 1] < -1.5).all()
    hips = skeleton.ends[0, skeleton.parents[0, 10::3]]
    torch.testing.assert_close(skeleton.starts[0, 10::3], hips)


def test_joints_of_a_chain_coincide():
    skeleton = rest(quadruped(3)[None])
    for bone, parent in enumerate(skeleton.parents[0].tolist()):
        if parent >= 0:
            torch.testing.assert_close(skeleton.starts[0, bone], skeleton.ends[0, parent])


def test_median_and_mean_origin_differ_on_a_lopsided_animal():
    verts = quadruped(0, legs=(2.0, 0.6, 0.6, 2.0), length=3.0)  # long front legs, few low vertices behind
    median, mean = (rest(verts[None], foot_origin=origin).ends[0, 8::3] for origin in ("median", "mean"))
    assert (median - mean).abs().max() > 0.01


def test_symmetric_feet_mirror_each_other():
    skeleton = rest(quadruped(0, legs=(1.0, 1.0, 1.4, 1.4))[None], symmetric_feet=True)
    feet = skeleton.ends[0, 8::3]
    torch.testing.assert_close(feet[[3, 2]], feet[[0, 1]] * torch.tensor([-1.0, 1.0, 1.0]))
    lone = rest(quadruped(0, legs=(1.0, 1.0, 1.4, 1.4))[None]).ends[0, 8::3, 1]
    torch.testing.assert_close(feet[1, 1], lone[1:3].mean())


def test_preset_attachment():
    skeleton = rest(quadruped(0)[None], attachment=[3, 6, 6, 3])
    assert skeleton.parents[0, 10::3].tolist() == [3, 6, 6, 3]


@pytest.mark.parametrize(
    "verts",
    [
        torch.zeros(1, 5, 3),
        torch.tensor([[[0.0, y, z] for y in (-1.0, 1.0) for z in (-2.0, 2.0)]]),
        torch.tensor([[[0.5, y, 1.0 + y] for y in (-1.0, 0.0, 1.0)]]),
    ],
    ids=["point", "plane x = 0", "one-sided"],
)
def test_degenerate_meshes_still_have_a_skeleton(verts):
    skeleton = rest(verts)
    assert torch.isfinite(skeleton.starts).all()
    assert torch.isfinite(skeleton.ends).all()


def test_without_a_vertex_beyond_the_margin_a_leg_takes_the_lowest_of_its_quarter():
    verts = quadruped(0)
    feet = rest(verts[None], margin=5.0).ends[0, 8::3]
    right = verts[(verts[:, 0] > 0) & (verts[:, 2] < 0)]  # the median z of four legs is near 0, no foot is
    torch.testing.assert_close(feet[1], right[right[:, 1].argmin()])
    assert (feet[:, 1] < -1.5).all()


def test_without_any_vertex_on_a_side_feet_lie_below_the_spine():
    plane = torch.stack((torch.zeros(50), torch.linspace(-1, 1, 50), torch.linspace(-2, 2, 50)), dim=-1)
    skeleton = rest(plane[None])
    torch.testing.assert_close(skeleton.ends[0, 8::3, 1], torch.full((4,), -1.0))
    torch.testing.assert_close(skeleton.ends[0, 8::3, 2], skeleton.ends[0, [2, 6, 6, 2], 2])


def test_no_gradient_and_no_change_of_the_input():
    verts = quadruped(0)[None].requires_grad_()
    before = verts.detach().clone()
    assert not rest(verts).starts.requires_grad
    assert torch.equal(verts.detach(), before)


def test_masked_quantiles_equal_quantiles_of_each_subset():
    generator = torch.Generator().manual_seed(0)
    values = torch.randn(3, 40, generator=generator)
    mask = torch.rand(3, 40, generator=generator) < torch.tensor([[0.2], [0.5], [1.0]])
    found = masked_quantiles(values, mask, (0.05, 0.5, 0.95))
    for row in range(3):
        expected = torch.quantile(values[row, mask[row]], torch.tensor([0.05, 0.5, 0.95]))
        torch.testing.assert_close(found[row], expected)


@pytest.fixture
def unchecked() -> Iterator[None]:
    """Values of a wrong type reach the code's own validation, as they do outside of tests."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"attachment": [1, 2, 3]}, "four body bones"),
        ({"attachment": [1, 2, 3, 8]}, "four body bones"),
        ({"attachment": "nearest"}, "z_nearest"),
        ({"foot_origin": "mode"}, "median or mean"),
        ({"foot_quantile": 0.0}, "foot_quantile"),
    ],
)
def test_bad_options(unchecked, changes, message):
    with pytest.raises(FaunaError, match=message):
        dataclasses.replace(OPTIONS, **changes)
