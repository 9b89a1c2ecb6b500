"""The data flow: what each stage switches, and what depends on what."""

from dataclasses import replace
from functools import partial
from unittest.mock import patch

import pytest
import torch

import fauna.model
from fauna.losses.objective import compared_pixels, image_terms
from fauna.losses.reconstruction import eroded_intersection, upsample
from fauna.random import Draws
from fauna.stages import Stage
from tests.test_system import batch, cfg, system  # noqa: F401


@pytest.fixture
def model(system):  # noqa: F811
    return system.model.eval()


@pytest.fixture
def photos(system):  # noqa: F811
    return batch(system, photos=3)


@torch.no_grad()
@pytest.mark.parametrize("articulation", [False, True])
@pytest.mark.parametrize("deformation", [False, True])
def test_stage_switches_parts(model, photos, articulation, deformation):
    model.set_stage(Stage(articulation=articulation, deformation=deformation))
    out = model(photos)
    assert (out.pose is not None) == (out.skeleton is not None) == articulation
    assert (out.instance.offsets is not None) == deformation
    assert out.instance.verts.shape[0] == (3 if deformation else 1)
    assert torch.equal(out.posed.canonical, out.base.verts)
    if not articulation:
        assert torch.equal(out.posed.verts, out.instance.verts.expand(3, -1, -1))


@torch.no_grad()
def test_rows_are_photos_or_all_hypotheses(model, photos):
    model.set_stage(Stage(hypotheses="all"))
    train, test = model(photos, Draws(0, 0)), model(photos)
    assert train.renders.silhouette.shape == (12, 32, 32)
    assert train.selection.photo.tolist() == [0] * 4 + [1] * 4 + [2] * 4
    assert test.renders.silhouette.shape == (3, 32, 32)
    assert torch.equal(test.selection.hypothesis, test.hypotheses.predicted_losses.argmin(dim=1))


@torch.no_grad()
def test_test_time_has_no_randomness_and_training_only_that_of_its_draws(model, photos):
    assert torch.equal(model(photos).renders.shading.rgb, model(photos).renders.shading.rgb)
    first, again, other = (model(photos, Draws(0, step)).base.verts for step in (3, 3, 4))
    assert torch.equal(first, again)
    assert first.shape != other.shape or not torch.equal(first, other)


@torch.no_grad()
def test_base_shape_is_of_the_mean_code(model, photos):
    out = model(photos)
    torch.testing.assert_close(out.code, out.readout.embedding.mean(dim=0))


@torch.no_grad()
def test_cached_features_give_what_the_images_give(model, photos):
    cached = replace(photos, features=model.encode(photos), encoder_images=None)
    assert torch.equal(model(photos).renders.silhouette, model(cached).renders.silhouette)
    assert torch.equal(model.feature_targets(photos), model.feature_targets(cached))


@torch.no_grad()
def test_given_feature_targets_win(model, photos):
    given = torch.full((3, 16, 4, 4), 0.5)
    assert model.feature_targets(replace(photos, feature_targets=given)) is given


@torch.no_grad()
def test_given_feature_targets_do_not_replace_raised_components(model, photos):
    given = replace(photos, feature_targets=torch.full((3, 16, 4, 4), 0.5))
    with patch.object(model.feature_space, "whitening", 0.7):
        assert torch.equal(model.feature_targets(given), model.feature_targets(photos))


def test_stage_travels_with_the_state(model):
    stage = Stage(articulation=False, temperature=0.3, weights={"mask": 2.0})
    model.set_stage(stage)
    saved = model.state_dict()
    model.set_stage(Stage())
    model.load_state_dict(saved)
    assert model.stage == stage
    assert not any(name.startswith("encoder.") for name in saved)


def test_training_shades_only_what_is_compared_and_its_losses_and_gradients_stay(model, photos):
    """Against a rendering of everything, compared on whole images."""
    model.set_stage(Stage(hypotheses="all"))
    stage = Stage(weights={"image": 1.0, "feature": 10.0}, hypotheses="all")
    results = []
    for wanted in (compared_pixels, None):
        with patch.object(fauna.model, "partial", (lambda *_: None) if wanted is None else partial):
            out = model(photos, Draws(0, 0))
        if wanted is None:
            terms = dense_image_terms(out, photos, model.feature_targets(photos))
        else:
            terms = image_terms(photos, model.feature_targets(photos), out, stage)
        total = terms["image"].mean() + 10 * terms["feature"].mean()
        parameters = [p for p in model.parameters() if p.requires_grad]
        grads = torch.autograd.grad(total, parameters, allow_unused=True)
        results.append(
            (terms, torch.cat([g.flatten() for g in grads if g is not None]), len(out.renders.shading.pixels))
        )
    (few, few_grad, few_count), (all_, all_grad, all_count) = results
    assert 0 < few_count < 0.9 * all_count
    for name in ("image", "feature"):
        torch.testing.assert_close(few[name], all_[name])
    torch.testing.assert_close(few_grad, all_grad, rtol=1e-4, atol=1e-7)


def dense_image_terms(out, photos, targets):
    """The image terms as they are written in the paper: on whole images."""
    renders, photo = out.renders, out.selection.photo
    region = eroded_intersection(renders.silhouette, photos.masks[photo], photos.valid[photo])[:, None]
    rgb, features = renders.image(renders.shading.rgb), renders.image(renders.shading.features)
    target = upsample(targets, *photos.masks.shape[-2:])[photo]
    return {
        "image": ((rgb - photos.images[photo]).abs() * region).mean(dim=(1, 2, 3)),
        "feature": ((features - target).square() * region).mean(dim=(1, 2, 3)),
    }


@torch.no_grad()
def test_a_random_share_of_the_pixels_is_unbiased(model, photos):
    stage = Stage(weights={"image": 1.0, "feature": 1.0})
    exact = image_terms(photos, model.feature_targets(photos), model(photos, Draws(0, 0)), stage)
    model.shade_fraction = 0.3
    lattice, found = Draws(0, 0).generator("lattice_jitter").get_state(), []
    for seed in range(60):
        draws = Draws(0, 0)
        with patch.object(Draws, "generator", lambda self, name, seed=seed: reseeded(name, lattice, seed)):
            found.append(image_terms(photos, model.feature_targets(photos), model(photos, draws), stage))
    for name in ("image", "feature"):
        values = torch.stack([terms[name] for terms in found])
        error = values.mean(dim=0) - exact[name]
        assert (values.std(dim=0) > 0).all()
        assert (error.abs() < 4 * values.std(dim=0) / 60**0.5).all()


@torch.no_grad()
def test_one_photo_gives_the_shape_of_a_training_batch(model, photos):
    features = model.feature_space.normalize(model.encode(photos))
    codes = model.bank(features.global_, photos.category).embedding
    assert torch.allclose(model(photos, Draws(0, 0)).code, codes.mean(dim=0))
    model.batch_code = "one"
    drawn = {int((codes - model(photos, Draws(0, step)).code).abs().sum(dim=1).argmin()) for step in range(12)}
    assert drawn == {0, 1, 2}
    assert torch.equal(model(photos, Draws(0, 3)).code, model(photos, Draws(0, 3)).code)


@torch.no_grad()
def test_what_lies_outside_the_photo_is_no_residual(model, photos):
    model.set_stage(Stage(articulation=True))
    base = model(photos)
    half = photos.valid.clone()
    half[..., : half.shape[-1] // 2] = 0
    args = (base.posed, base.base, base.selection, base.camera, photos.masks)
    whole, cut = model._residual(*args, torch.ones_like(half)), model._residual(*args, half)
    assert torch.equal(cut, whole * half)
    assert whole.abs().sum() > cut.abs().sum() > 0


def reseeded(name, lattice, seed):
    """The same lattice in every draw, other pixels in each."""
    generator = torch.Generator()
    if name == "lattice_jitter":
        generator.set_state(lattice)
        return generator
    return generator.manual_seed(seed if name == "shading" else 0)
