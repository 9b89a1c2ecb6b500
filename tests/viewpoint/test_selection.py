from collections.abc import Iterator

import jaxtyping
import pytest
import torch

from fauna.errors import FaunaError
from fauna.geometry.rotations import look_at_rotation
from fauna.types import Hypotheses
from fauna.viewpoint.selection import best, camera_for, mixed_probabilities, select


def hypotheses(photos: int) -> Hypotheses:
    generator = torch.Generator().manual_seed(0)
    losses = torch.randn(photos, 4, generator=generator)
    rotations = look_at_rotation(torch.randn(photos, 4, 3, generator=generator))
    return Hypotheses(rotations, torch.randn(photos, 3, generator=generator), losses, torch.softmax(-losses, dim=1))


def draw(given: Hypotheses, seed: int, **changes) -> torch.Tensor:
    options = {"mode": "one", "uniform_mix": 0.0, "best_fraction": 0.0}
    generator = torch.Generator().manual_seed(seed)
    selection = select(given, **{**options, **changes}, generator=generator)
    assert torch.equal(selection.photo, torch.arange(len(selection.photo)))
    return selection.hypothesis


def test_all_renders_every_hypothesis_photo_major():
    selection = select(
        hypotheses(3), mode="all", uniform_mix=0.3, best_fraction=0.5, generator=torch.Generator().manual_seed(0)
    )
    assert selection.photo.tolist() == [0] * 4 + [1] * 4 + [2] * 4
    assert selection.hypothesis.tolist() == [0, 1, 2, 3] * 3


def test_best_has_the_lowest_predicted_loss():
    given = hypotheses(5)
    assert torch.equal(best(given).hypothesis, given.predicted_losses.argmin(1))
    assert torch.equal(draw(given, 0, best_fraction=1.0), best(given).hypothesis)


@pytest.mark.parametrize("photos", [1, 3, 6])
def test_exploration_is_uniform_for_every_photo(photos):
    given = hypotheses(photos)
    draws = torch.stack([draw(given, seed) for seed in range(800)])
    counts = torch.stack([(draws == k).double().mean(0) for k in range(4)])
    assert (counts - 0.25).abs().max() < 0.06


def test_exploration_is_even_over_the_batch():
    for seed in range(20):
        assert torch.bincount(draw(hypotheses(8), seed), minlength=4).tolist() == [2, 2, 2, 2]


def test_the_share_of_best_hypotheses_is_the_fraction_on_average():
    given = hypotheses(6)
    favourite = best(given).hypothesis
    draws = torch.stack([draw(given, seed, best_fraction=0.8) for seed in range(1000)])
    share = (draws == favourite).double().mean()
    assert float(share) == pytest.approx(0.8 + 0.2 * 0.25, abs=0.02)  # the others hit it by chance


def test_a_fully_uniform_mix_ignores_the_predictions():
    given = hypotheses(6)
    assert torch.equal(draw(given, 3, uniform_mix=1.0, best_fraction=1.0), draw(given, 3))


def test_mixed_probabilities():
    given = hypotheses(2)
    torch.testing.assert_close(mixed_probabilities(given, 1.0), torch.full((2, 4), 0.25))
    assert torch.equal(mixed_probabilities(given, 0.0), given.probabilities)
    torch.testing.assert_close(mixed_probabilities(given, 0.3).sum(1), torch.ones(2))


def test_draws_are_a_function_of_the_generator():
    given = hypotheses(6)
    assert torch.equal(draw(given, 5, best_fraction=0.5), draw(given, 5, best_fraction=0.5))
    assert any(not torch.equal(draw(given, 5), draw(given, seed)) for seed in range(6, 12))


def test_cameras_follow_the_selection():
    given = hypotheses(2)
    selection = select(
        given, mode="all", uniform_mix=0.0, best_fraction=0.0, generator=torch.Generator().manual_seed(0)
    )
    camera = camera_for(given, selection, fov_deg=25.0, distance=10.0)
    torch.testing.assert_close(camera.camera_from_world[5, :3, :3], given.rotations[1, 1])
    expected = given.translation[1] - torch.tensor([0.0, 0.0, 10.0])
    torch.testing.assert_close(camera.camera_from_world[5, :3, 3], expected)


@pytest.fixture
def unchecked() -> Iterator[None]:
    """Values of a wrong type reach the code's own validation, as they do outside of tests."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


def test_an_unknown_mode_is_refused(unchecked):
    with pytest.raises(FaunaError, match="one or all, got 'two'"):
        draw(hypotheses(2), 0, mode="two")
