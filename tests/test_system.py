"""Optimiser groups, and which parameters a step of either player touches."""

from dataclasses import replace

import pytest
import torch

from fauna.build import build_encoder, build_model, build_schedule, build_system
from fauna.configuration import validate
from fauna.data.photo_loader import PhotoLoader
from fauna.data.sources import FaunaFolder
from fauna.random import Draws
from fauna.stages import Stage
from fauna.system import FaunaSystem, parameter_groups
from fauna.types import Batch
from tests.runs import composed, dataset, tiny


@pytest.fixture(scope="module")
def cfg():
    configuration = composed(*tiny())
    validate(configuration)
    return configuration


@pytest.fixture
def system(cfg) -> FaunaSystem:
    torch.manual_seed(0)
    encoder = build_encoder(cfg)
    built = build_system(cfg, build_model(cfg, encoder))
    loader = photo_loader(encoder)
    photos = [photo for each in folder().categories().values() for photo in each.train]
    built.model.feature_space.fit(loader.sample(photo) for photo in photos)
    return built


def folder() -> FaunaFolder:
    return FaunaFolder(root=str(dataset()), photograph_pattern=r"(.+_\d+)_\d+")


def photo_loader(encoder) -> PhotoLoader:
    return PhotoLoader(encoder=encoder, image_size=32, valid_margin=0.02, cache_features=False, memory_megabytes=10)


def batch(system: FaunaSystem, photos: int = 2) -> Batch:
    return photo_loader(system.model.encoder).batch(folder().categories()["long"].train[:photos], [False] * photos, 0)


def open_window(system: FaunaSystem, cfg, step: int = 13) -> Stage:
    stage = build_schedule(cfg).at(step)
    system.model.set_stage(stage)
    system.adversarial = stage.adversarial
    return stage


def with_gradient(module: torch.nn.Module) -> set[str]:
    return {name for name, parameter in module.named_parameters() if parameter.grad is not None}


def test_every_trainable_parameter_is_in_exactly_one_group(system):
    generator, discriminator = system.configure_optimizers()
    ours = [id(p) for group in generator.param_groups for p in group["params"]]
    theirs = [id(p) for group in discriminator.param_groups for p in group["params"]]
    assert len(ours + theirs) == len(set(ours + theirs))
    encoder = {id(p) for p in system.model.encoder.parameters()}
    assert set(ours) == {id(p) for p in system.model.parameters() if p.requires_grad}
    assert set(theirs) == {id(p) for p in system.adversary.parameters()}
    assert not encoder & set(ours + theirs)
    assert not any(p.requires_grad for p in system.model.encoder.parameters())


def test_prior_is_bank_shape_and_feature_field(system, cfg):
    groups = parameter_groups(system.model)
    prior, viewpoint, rest = groups["prior"], groups["viewpoint"], groups["rest"]
    names = {id(p): name for name, p in system.model.named_parameters()}
    assert {names[id(p)].split(".")[0] for p in prior} == {"bank", "shape", "appearance"}
    assert all(
        names[id(p)].startswith("appearance.feature_field") for p in prior if names[id(p)].startswith("appearance")
    )
    assert {names[id(p)].split(".")[0] for p in rest} == {
        "embedder",
        "deformation",
        "articulation",
        "appearance",
    }
    seen = [*system.model.viewpoint.parameters(), *system.model.mask_embedding.parameters()]
    assert {id(p) for p in viewpoint} == {id(p) for p in seen}
    rates = [group["lr"] for group in system.configure_optimizers()[0].param_groups]
    assert rates == [cfg.optimizer.prior_lr, cfg.optimizer.lr, cfg.optimizer.lr]


def test_a_system_without_adversary_still_has_two_optimisers():
    small = composed(*tiny("discriminator=none"))
    validate(small)
    system = build_system(small, build_model(small, build_encoder(small)))
    assert len(system.configure_optimizers()) == 2
    assert not list(system.adversary.parameters())


def test_generator_losses_leave_the_discriminator_without_gradient(system, cfg):
    open_window(system, cfg)
    losses, _, pair = system.generator_losses(batch(system), Draws(0, 13))
    assert "adversarial" in losses.terms
    losses.total.backward()
    assert with_gradient(system.adversary) == set()
    assert all(parameter.requires_grad for parameter in system.adversary.parameters())
    assert {name.split(".")[0] for name in with_gradient(system.model)} >= {
        "bank",
        "shape",
        "articulation",
        "viewpoint",
    }
    assert not pair.real.requires_grad
    assert not pair.fake.requires_grad
    assert not pair.condition.requires_grad


def test_discriminator_loss_leaves_the_model_without_gradient(system, cfg):
    open_window(system, cfg)
    with torch.no_grad():
        _, _, pair = system.generator_losses(batch(system), Draws(0, 13))
    system.adversary.discriminator_loss(pair)["discriminator"].backward()
    assert with_gradient(system.model) == set()
    assert with_gradient(system.adversary) == {name for name, _ in system.adversary.named_parameters()}


def test_adversarial_gradient_reaches_shape_but_not_viewpoint(system, cfg):
    open_window(system, cfg)
    out = system.model(batch(system), Draws(0, 13))
    loss, _ = system.adversary.generator_loss(
        batch(system), out, system.model.renderer, system.model.camera, Draws(0, 13)
    )
    loss.backward()
    touched = {name.split(".")[0] for name in with_gradient(system.model)}
    assert touched >= {"bank", "shape", "articulation"}
    assert not touched & {"viewpoint", "appearance"}


def test_outside_the_window_there_is_no_adversarial_term(system, cfg):
    for step in (11, 20):
        open_window(system, cfg, step)
        losses, _, pair = system.generator_losses(batch(system), Draws(0, step))
        assert "adversarial" not in losses.terms
        assert pair is None


def test_a_steps_losses_are_a_function_of_seed_and_step(system, cfg):
    open_window(system, cfg)
    first, again, other = (system.generator_losses(batch(system), Draws(0, step))[0].total for step in (13, 13, 14))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_learning_rates_follow_the_stage(system, cfg):
    optimizers = system.configure_optimizers()

    class FakeTrainer:
        world_size = 1

    system._trainer = FakeTrainer()
    system.optimizers = lambda use_pl_optimizer=True: optimizers
    system.set_stage(build_schedule(cfg).at(22))
    scale = build_schedule(cfg).at(22).lr_scale
    assert 0.5 < scale < 1
    assert cfg.schedule.viewpoint_lr[-1][1] == 0.1
    for optimizer in optimizers:
        for group in optimizer.param_groups:
            own = 0.1 if group.get("name") == "viewpoint" else 1.0
            assert group["lr"] == pytest.approx(group["initial_lr"] * scale * own)


def test_what_stands_still_does_not_count_in_the_norm(system):
    """However large its gradients are, or no numbers at all: everything else moves as if they were not there."""
    system.options = replace(system.options, clip_norm=1.0)
    optimizer = system.configure_optimizers()[0]
    frozen = next(group for group in optimizer.param_groups if group["name"] == "viewpoint")
    frozen["lr"] = 0.0
    other = next(group for group in optimizer.param_groups if group["name"] == "rest")["params"][0]
    before = [parameter.detach().clone() for parameter in frozen["params"]]
    for value in (1e6, torch.nan):
        other.grad = torch.zeros_like(other)
        other.grad.view(-1)[0] = 0.5  # below the limit
        for parameter in frozen["params"]:
            parameter.grad = torch.full_like(parameter, value)
        system._finish(optimizer, list(system.model.parameters()), torch.zeros(()))
        assert system.last_finite
        assert float(other.grad.view(-1)[0]) == 0.5
        assert all(map(torch.equal, before, frozen["params"]))
