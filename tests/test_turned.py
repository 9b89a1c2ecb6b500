"""A turned model: the same pictures, losses and gradients, with the head at +z and every bone named as it lies."""

from dataclasses import replace

import pytest
import torch

from fauna.build import build_encoder, build_model, build_system
from fauna.evaluation.predict import predict
from fauna.geometry.half_turn import half_turn, turn_angles, turn_skeleton
from fauna.geometry.skeleton import LEG_SIDE_X
from fauna.geometry.skinning import skinning_weights
from fauna.io.checkpoint import load_weights, read_weights, save_weights
from fauna.random import Draws
from fauna.stages import Stage
from fauna.types import InstanceShape
from tests.runs import composed, reference_run, tiny
from tests.test_system import batch, folder, photo_loader

TURN = torch.diag(torch.tensor([-1.0, 1.0, -1.0, 1.0]))
WEIGHTS = {
    "mask": 1.0,
    "mask_miss": 1.0,
    "image": 1.0,
    "feature": 1.0,
    "hypothesis": 1.0,
    "eikonal": 1.0,
    "articulation": 1.0,
}
VARIANTS = {
    "symmetric": (),
    "published": (
        "appearance.feature_field.symmetric=false",
        "deformation.mirror_x=false",
        "articulation.bone_index=add",
    ),
    "at pixels": ("feature_lookup=pixels", "articulation.bone_index=concat"),
}


def random_system(overrides: tuple[str, ...]):
    """Random weights, loud enough that every part does something; the body is longer and thicker at -z."""
    torch.manual_seed(0)
    cfg = composed(
        *tiny("deformation=laptop", "articulation=laptop", "shape=laptop", "shape.grid_resolution=32", *overrides)
    )
    system = build_system(cfg, build_model(cfg, build_encoder(cfg)))
    model = system.model
    loader, photos = photo_loader(model.encoder), [p for each in folder().categories().values() for p in each.train]
    model.feature_space.fit(loader.sample(photo) for photo in photos)
    with torch.no_grad():
        model.articulation.out_layer.weight.mul_(60)
        model.deformation.field.mlp.layers[-1].weight.mul_(8)
        model.shape.sdf.residual_scale = 0.5
        model.shape.sdf.in_layer.weight[:, 2] -= 0.2
    model.set_stage(Stage(weights=WEIGHTS, target_weights={"mask": 1.0}))
    return system


@pytest.fixture(scope="module", params=VARIANTS.values(), ids=VARIANTS)
def system(request):
    return random_system(request.param)


@pytest.fixture
def both(system):
    """Reconstructions of two photographs before and after turning."""
    model, photos = system.model.eval(), batch(system, photos=2)
    with torch.no_grad():
        before = model(photos)
        model.set_turned(True)
        after = model(photos)
    model.set_turned(False)
    return before, after


def close(first, second, atol: float = 1e-5) -> None:
    torch.testing.assert_close(first, second, rtol=0, atol=atol)


def test_every_part_does_something(both):
    before, _ = both
    assert before.pose.angles.abs().mean() > 0.03
    assert before.instance.offsets.abs().mean() > 0.003
    z = before.base.verts[:, 2]
    assert (z.max() + z.min()).abs() > 0.02  # the two ends differ
    assert 0.02 < before.renders.covered.float().mean() < 0.98


def test_pictures_stay(both):
    before, after = both
    close(after.renders.silhouette, before.renders.silhouette)
    assert torch.equal(after.renders.shading.pixels, before.renders.shading.pixels)
    close(after.renders.shading.rgb, before.renders.shading.rgb)
    close(after.renders.shading.features, before.renders.shading.features)
    close(after.light.direction, before.light.direction)
    assert torch.equal(after.selection.hypothesis, before.selection.hypothesis)


def test_geometry_turns(both):
    before, after = both
    close(after.base.verts, half_turn(before.base.verts), 0)
    assert torch.equal(after.base.faces, before.base.faces)
    for name in ("verts", "offsets"):
        close(getattr(after.instance, name), half_turn(getattr(before.instance, name)))
    for name in ("verts", "canonical"):
        close(getattr(after.posed, name), half_turn(getattr(before.posed, name)))
    close(after.camera.camera_from_world, before.camera.camera_from_world @ TURN)
    close(after.camera.clip_from_world, before.camera.clip_from_world @ TURN)
    close(after.hypotheses.rotations[..., 2], -before.hypotheses.rotations[..., 2])
    close(after.hypotheses.translation, before.hypotheses.translation, 0)


def test_bones_are_named_as_they_lie(both):
    before, after = both
    expected = turn_skeleton(before.skeleton)
    close(after.skeleton.starts, expected.starts)
    close(after.skeleton.ends, expected.ends)
    assert torch.equal(after.skeleton.parents, expected.parents)
    close(after.pose.angles, turn_angles(before.pose.angles))
    for skeleton in (before.skeleton, after.skeleton):
        assert (skeleton.ends[:, 0, 2] > skeleton.ends[:, 4, 2] + 1).all()  # tip of the spine at +z, tip at -z
        feet = skeleton.ends[:, 8::3]
        assert (feet[..., 0].sign() == torch.tensor(LEG_SIDE_X)).all()
        assert (feet[:, [0, 3], 2] > feet[:, [1, 2], 2]).all()
    head = before.skeleton.ends[:, 4]  # at -z
    close(after.skeleton.ends[:, 0], half_turn(head))
    close(after.posed.bone_ends[:, 0], half_turn(before.posed.bone_ends[:, 4]))


def test_what_is_handed_out_fits_together(system, both):
    """Parts that are asked from outside speak the frame that the reconstruction is in."""
    model, (before, after) = system.model, both
    model.set_turned(True)
    try:
        with torch.no_grad():
            posed = model.rig.pose(after.base, after.instance, after.skeleton, after.pose)
            again = model.rig.rest(after.instance, legs_attached=True)
            points, row = after.posed.canonical, torch.zeros(len(after.posed.canonical), dtype=torch.int64)
            texture = torch.randn(1, system.model.appearance.albedo_field.field.condition_dim)
            albedo, features = (
                model.appearance.albedo(points, texture, row),
                model.appearance.features(points, after.code),
            )
            eikonal = model.shape.eikonal(after.code, after.base, torch.Generator().manual_seed(1))
    finally:
        model.set_turned(False)
    close(posed.verts, after.posed.verts, 0)
    close(again.starts, after.skeleton.starts, 0)
    with torch.no_grad():
        close(albedo, model.appearance.albedo(before.posed.canonical, texture, row))
        close(features, model.appearance.features(before.posed.canonical, before.code))
        close(eikonal, model.shape.eikonal(before.code, before.base, torch.Generator().manual_seed(1)))


def test_training_goes_on_as_before(system):
    """Losses and gradients of a training step with its random draws."""
    model, photos, found = system.model.train(), batch(system, photos=2), []
    model.set_stage(replace(model.stage, hypotheses="all"))
    for turned in (False, True):
        model.set_turned(turned)
        model.zero_grad()
        losses = system.generator_losses(photos, Draws(0, 5))[0]
        losses.total.backward()
        grads = {name: p.grad.clone() for name, p in model.named_parameters() if p.grad is not None}
        found.append(({name: float(value.detach()) for name, value in losses.terms.items()}, grads))
    model.set_turned(False)
    model.set_stage(replace(model.stage, hypotheses="one"))
    (terms, grads), (turned_terms, turned_grads) = found
    assert terms.keys() == turned_terms.keys()
    assert all(turned_terms[name] == pytest.approx(terms[name], rel=1e-4) for name in terms)
    assert grads.keys() == turned_grads.keys()
    for name, grad in grads.items():
        torch.testing.assert_close(
            turned_grads[name], grad, rtol=1e-2, atol=1e-3 * float(grad.abs().max()) + 1e-7, msg=name
        )


def test_a_prediction_says_it_is_looked_at_from_the_other_end(system):
    model, photo = system.model.eval(), batch(system, photos=1)
    before = predict(model, photo, category="x", size=32)[0]
    model.set_turned(True)
    after, after_out = predict(model, photo, category="x", size=32)
    model.set_turned(False)
    assert abs(after.silhouette.astype(int) - before.silhouette.astype(int)).max() <= 1
    close(torch.from_numpy(after.forwards), torch.from_numpy(-before.forwards))
    weights = skinning_weights(
        after_out.instance.verts,
        after_out.skeleton,
        temperature=model.rig.skin_temperature,
        distance=model.rig.skin_distance,
    )[0]
    named = torch.tensor([4, 5, 6, 7, 0, 1, 2, 3, *range(14, 20), *range(8, 14)])[torch.from_numpy(before.bone).long()]
    bone, row = torch.from_numpy(after.bone).long(), torch.arange(len(after.bone))
    assert (bone == named).float().mean() > 0.9
    close(weights[row, bone], weights[row, named], 1e-4)  # the rest lies as near to one bone as to the other


def test_the_turn_travels_with_weights_and_checkpoints(system, tmp_path):
    path = tmp_path / "w.safetensors"
    system.model.set_turned(True)
    save_weights(system.model, path, config="name: x\n", species=["a"], half=False)
    state = system.model.state_dict()
    system.model.set_turned(False)
    assert read_weights(path)[1]["turned"] is True
    load_weights(system.model, path)
    assert system.model.turned
    assert all(part.turned for part in (system.model.shape, system.model.rig, system.model.articulation))
    system.model.set_turned(False)
    system.model.load_state_dict(state)
    assert system.model.turned
    state["_extra_state"].pop("turned")  # written before there was a turn
    system.model.load_state_dict(state)
    assert not system.model.turned
    assert read_weights(reference_run() / "weights.safetensors")[1]["turned"] is False
    assert read_weights(reference_run() / "checkpoints" / "step-0000030.ckpt")[1]["turned"] is False


def test_a_shape_made_from_a_code_alone_turns_too(system, both):
    """As a baseline does that draws the mean code's shape in predicted cameras."""
    model, (before, after) = system.model, both
    bones = []
    for turned in (False, True):
        model.set_turned(turned)
        with torch.no_grad():
            base = model.shape(before.code, None)
        bones.append(model.rig.rest(InstanceShape(base.verts[None]), legs_attached=True))
    model.set_turned(False)
    close(base.verts, after.base.verts)
    close(bones[1].ends, turn_skeleton(bones[0]).ends)
