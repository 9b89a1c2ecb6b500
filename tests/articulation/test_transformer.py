import math
from collections.abc import Iterator

import jaxtyping
import pytest
import torch

from fauna.articulation.none import NoArticulation
from fauna.articulation.transformer import ArticulationTransformer
from fauna.errors import FaunaError
from fauna.geometry.camera import make_camera, project
from fauna.geometry.rotations import rotation_y
from fauna.types import Camera, Features, Skeleton

OPTIONS = {
    "geometry_dim": 6,
    "key_dim": 5,
    "local_points": [0.5, 1.0],
    "local_dim": 4,
    "residual_points": 0,
    "residual_window": 0.4,
    "normalize_inputs": True,
    "bone_index": "both",
    "num_octaves": 2,
    "position_scale": 2 / 7,
    "camera_distance": 10.0,
    "hidden_dim": 16,
    "num_blocks": 2,
    "num_heads": 4,
    "mlp_ratio": 2.0,
    "output_gain": 0.5,
    "output_init": 1.0,
    "max_angle_deg": 60.0,
    "body_sideways_deg": 60.0,
    "body_twist_deg": 6.0,
}


def network(**changes) -> ArticulationTransformer:
    torch.manual_seed(0)
    return ArticulationTransformer(**{**OPTIONS, **changes})


def inputs(rows: int = 3, skeletons: int = 1) -> tuple[Features, torch.Tensor, Skeleton, Camera]:
    generator = torch.Generator().manual_seed(0)
    keys = torch.randn(rows, 5, 8, 8, generator=generator)
    geometry = torch.randn(rows, 6, generator=generator)
    starts, ends = torch.randn(2, skeletons, 20, 3, generator=generator).unbind(0)
    skeleton = Skeleton(starts, ends, torch.full((skeletons, 20), -1))
    camera = make_camera(rotation_y(torch.arange(float(rows))), 0.3 * torch.ones(rows, 3), fov_deg=25.0, distance=10.0)
    return Features(torch.zeros(rows, 2), keys, keys), geometry, skeleton, camera


def test_published_network_has_the_published_number_of_parameters():
    net = network(
        geometry_dim=256,
        key_dim=384,
        local_points=[0.5],
        local_dim=None,
        normalize_inputs=False,
        num_octaves=8,
        hidden_dim=256,
        num_blocks=4,
        num_heads=8,
    )
    assert sum(p.numel() for p in net.parameters()) == 2_309_891


@pytest.mark.parametrize("bone_index", ["add", "concat", "both", "learned"])
@pytest.mark.parametrize("local_dim", [4, None])
@pytest.mark.parametrize("normalize_inputs", [True, False])
def test_every_variant_predicts_angles_within_the_limits(bone_index, local_dim, normalize_inputs):
    net = network(bone_index=bone_index, local_dim=local_dim, normalize_inputs=normalize_inputs, output_gain=50.0)
    angles = net(*inputs(), leg_limits="paper").angles
    assert angles.shape == (3, 20, 3)
    assert angles.abs().max() <= math.radians(60.0) + 1e-6
    assert angles.abs().max() > math.radians(50.0)
    assert angles[:, :8, 2].abs().max() <= math.radians(6.0) + 1e-6
    assert (angles.abs() <= net.limits("paper") + 1e-6).all()
    assert (angles[:, [8, 9, 11, 12], 1:] == 0).all()
    assert (angles[:, [10, 13], 1:] != 0).all()


def test_rows_do_not_influence_each_other():
    net = network()
    features, geometry, skeleton, camera = inputs()
    angles = net(features, geometry, skeleton, camera, leg_limits="early").angles
    index = torch.tensor([2])
    alone = net(features.rows(index), geometry[index], skeleton, camera.rows(index), leg_limits="early").angles
    torch.testing.assert_close(alone, angles[2:], atol=1e-6, rtol=1e-4)


def test_a_skeleton_of_each_row_equals_a_shared_one():
    net = network()
    features, geometry, skeleton, camera = inputs()
    repeated = skeleton.rows(torch.zeros(3).long())
    torch.testing.assert_close(
        net(features, geometry, repeated, camera, leg_limits="early").angles,
        net(features, geometry, skeleton, camera, leg_limits="early").angles,
    )


def test_rows_of_a_photo_take_its_features_embedding_and_bones():
    net = network()
    features, geometry, skeleton, _ = inputs(rows=2, skeletons=2)
    camera = make_camera(rotation_y(torch.arange(6.0)), 0.3 * torch.ones(6, 3), fov_deg=25.0, distance=10.0)
    photo = torch.tensor([0, 0, 0, 1, 1, 1])
    repeated = net(features.rows(photo), geometry[photo], skeleton.rows(photo), camera, leg_limits="early").angles
    shared = net(features, geometry, skeleton, camera, leg_limits="early").angles
    torch.testing.assert_close(shared, repeated, atol=1e-6, rtol=1e-4)


def test_photos_have_equally_many_rows():
    features, geometry, skeleton, camera = inputs()
    fewer = torch.tensor([0, 1])
    with pytest.raises(ValueError, match="3 rows of 2 photos"):
        network()(features.rows(fewer), geometry[fewer], skeleton, camera, leg_limits="early")


def test_local_features_are_those_under_the_bone():
    _, _, skeleton, camera = inputs()
    centres = (torch.arange(8) + 0.5) / 4 - 1
    rows, columns = torch.meshgrid(centres, centres, indexing="ij")
    ramp = torch.stack((columns, rows, columns, rows, rows)).expand(3, -1, -1, -1)  # the value IS the position
    starts, ends = skeleton.starts.expand(3, -1, -1), skeleton.ends.expand(3, -1, -1)
    sampled = network().sample_keys(ramp, starts, ends, camera)
    places = torch.stack((0.5 * (skeleton.starts + skeleton.ends), skeleton.ends), dim=2).flatten(1, 2)
    ndc = project(places, camera).unflatten(1, (20, 2))
    inside = (ndc.abs() < 0.85).all(-1)
    assert inside.sum() > 40
    torch.testing.assert_close(sampled[..., :2][inside], ndc[inside], atol=1e-5, rtol=1e-4)


def test_the_residual_is_read_around_the_middle_of_each_bone():
    _, _, skeleton, camera = inputs()
    net = network(residual_points=3, residual_window=0.2)
    centres = (torch.arange(32) + 0.5) / 16 - 1
    ramps = torch.stack([10 * centres[:, None] + centres + row for row in range(3)])  # value = 10 y + x + row
    starts, ends = skeleton.starts.expand(3, -1, -1), skeleton.ends.expand(3, -1, -1)
    sampled = net.sample_residual(ramps, starts, ends, camera)
    middle = project(0.5 * (skeleton.starts + skeleton.ends), camera)
    places = [middle + torch.tensor([dx, dy]) for dx in (-0.2, 0.0, 0.2) for dy in (-0.2, 0.0, 0.2)]
    ndc = torch.stack(places, dim=2)
    inside = (ndc.abs() < 0.9).all(-1)
    expected = 10 * ndc[..., 1] + ndc[..., 0] + torch.arange(3.0)[:, None, None]
    assert inside.sum() > 200
    torch.testing.assert_close(sampled[inside], expected[inside], atol=1e-4, rtol=1e-4)
    outside = network(residual_points=2, residual_window=3.0).sample_residual(ramps + 30, starts, ends, camera)
    assert torch.equal(outside, torch.zeros(3, 20, 4))


def test_the_residual_moves_the_bones():
    net, given = network(residual_points=5), inputs()
    still = net(*given, torch.zeros(3, 16, 16), leg_limits="early").angles
    moved = net(*given, torch.ones(3, 16, 16), leg_limits="early").angles
    assert net.compares_outline
    assert (moved - still).abs().max() > 1e-3


def test_learned_codes_tell_bones_apart_that_see_the_same():
    net = network(bone_index="learned")
    features, geometry, skeleton, camera = inputs()
    same = Skeleton(
        skeleton.starts[:, :1].expand(-1, 20, -1), skeleton.ends[:, :1].expand(-1, 20, -1), skeleton.parents
    )
    net.index_code.zero_()
    upper = net(features, geometry, same, camera, leg_limits="early").angles[:, [10, 19]]
    assert (upper[:, 0] - upper[:, 1]).abs().max() > 1e-3
    assert net.bone_code is not None
    torch.nn.init.zeros_(net.bone_code)
    upper = net(features, geometry, same, camera, leg_limits="early").angles[:, [10, 19]]
    torch.testing.assert_close(upper[:, 0], upper[:, 1])


def test_positions_are_in_the_camera_frame_and_about_unit_size():
    _, _, skeleton, _ = inputs()
    camera = make_camera(torch.eye(3)[None], torch.zeros(1, 3), fov_deg=25.0, distance=10.0)
    positions = network().positions(skeleton.starts, skeleton.ends, camera)
    torch.testing.assert_close(positions[..., 2:5], skeleton.starts * 2 / 7)
    torch.testing.assert_close(positions[..., 5:8], skeleton.ends * 2 / 7)
    torch.testing.assert_close(positions[0, [0, 19], 8], torch.tensor([-0.95, 0.95]))


def test_camera_receives_no_gradient_but_the_embedding_does():
    net = network()
    features, geometry, skeleton, _ = inputs()
    translation = torch.zeros(3, 3, requires_grad=True)
    geometry.requires_grad_()
    camera = make_camera(torch.eye(3).expand(3, 3, 3), translation, fov_deg=25.0, distance=10.0)
    net(features, geometry, skeleton, camera, leg_limits="early").angles.square().sum().backward()
    assert translation.grad is None
    assert geometry.grad is not None
    assert geometry.grad.abs().sum() > 0
    assert all(parameter.grad is not None for parameter in net.parameters())


def test_bitwise_repeatable_in_deterministic_mode():
    torch.use_deterministic_algorithms(True)
    try:
        results = []
        for _ in range(2):
            net = network()
            angles = net(*inputs(), leg_limits="early").angles
            results.append((angles, *torch.autograd.grad(angles.square().sum(), list(net.parameters()))))
    finally:
        torch.use_deterministic_algorithms(False)
    assert all(torch.equal(a, b) for a, b in zip(*results, strict=True))


def test_no_articulation_keeps_the_bones_at_rest():
    assert torch.equal(NoArticulation().limits("early"), torch.zeros(20, 3))
    assert torch.equal(NoArticulation()(*inputs(), leg_limits="early").angles, torch.zeros(3, 20, 3))


@pytest.fixture
def unchecked() -> Iterator[None]:
    """Values of a wrong type reach the code's own validation, as they do outside of tests."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


def test_bad_options(unchecked):
    with pytest.raises(FaunaError, match="add, concat, both or learned, got 'none'"):
        network(bone_index="none")
    with pytest.raises(FaunaError, match="multiple of num_heads, got 16 and 3"):
        network(num_heads=3)
