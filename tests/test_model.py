"""The data flow: what each stage switches, and what depends on what."""

from dataclasses import replace

import pytest
import torch

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
    assert torch.equal(model(photos).renders.rgb, model(photos).renders.rgb)
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


def test_stage_travels_with_the_state(model):
    stage = Stage(articulation=False, temperature=0.3, weights={"mask": 2.0})
    model.set_stage(stage)
    saved = model.state_dict()
    model.set_stage(Stage())
    model.load_state_dict(saved)
    assert model.stage == stage
    assert not any(name.startswith("encoder.") for name in saved)
