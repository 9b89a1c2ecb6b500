"""Regularisers, hypothesis terms and adversarial terms against their definitions."""

import math

import pytest
import torch
from torch.nn import functional as F

from fauna.losses.adversarial import adversarial_loss, discriminator_loss, gradient_penalty
from fauna.losses.hypothesis import hypothesis_loss, row_weights
from fauna.losses.regularizers import SIDE_SPREAD, articulation_loss, deformation_loss, side_view_loss


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def weights(weighting: str, measured: torch.Tensor, *, all_rendered: bool, temperature: float = 0.5):
    rows = measured.shape[0]
    return row_weights(
        weighting,
        probability=torch.linspace(0.1, 0.7, rows, dtype=measured.dtype),
        relative=torch.linspace(0.2, 1.0, rows, dtype=measured.dtype),
        measured=measured,
        num_hypotheses=4,
        temperature=temperature,
        all_rendered=all_rendered,
    )


# --- regularisers ----------------------------------------------------------------------------------------------------


def test_articulation_norms():
    angles = draw(2, 4, 3)
    by_bone = [sum(float(a) ** 2 for a in bone) for row in angles for bone in row]
    assert float(articulation_loss(angles, "vector")) == pytest.approx(sum(by_bone) / 8)
    assert float(articulation_loss(angles, "component")) == pytest.approx(sum(by_bone) / 24)


def test_deformation_is_the_mean_squared_component():
    offsets = draw(2, 5, 3, seed=1)
    assert float(deformation_loss(offsets)) == pytest.approx(sum(float(o) ** 2 for o in offsets.flatten()) / 30)


def test_regulariser_gradients():
    angles = draw(1, 3, 3).requires_grad_(True)
    assert torch.autograd.gradcheck(lambda a: articulation_loss(a, "vector"), angles)
    assert torch.autograd.gradcheck(lambda a: articulation_loss(a, "component"), angles)
    assert torch.autograd.gradcheck(deformation_loss, angles)


# --- hypotheses ------------------------------------------------------------------------------------------------------


def test_hypothesis_target_is_detached():
    predicted, measured = draw(4).requires_grad_(True), draw(4, seed=2).requires_grad_(True)
    loss = hypothesis_loss(predicted, measured)
    assert loss.item() == pytest.approx(
        sum((p - m) ** 2 for p, m in zip(predicted.tolist(), measured.tolist(), strict=True)) / 4
    )
    loss.backward()
    assert measured.grad is None
    torch.testing.assert_close(predicted.grad, 2 * (predicted - measured).detach() / 4)


@pytest.mark.parametrize("all_rendered", [False, True])
def test_uniform_weights_give_the_plain_mean(all_rendered):
    measured = draw(8).abs()
    assert torch.equal(weights("uniform", measured, all_rendered=all_rendered), torch.ones_like(measured))


def test_probability_weights_average_one_over_the_hypotheses():
    measured = draw(4).abs()
    given = weights("probability", measured, all_rendered=False)
    torch.testing.assert_close(given, 4 * torch.linspace(0.1, 0.7, 4, dtype=torch.float64))


def test_an_explored_viewpoint_counts_as_far_as_it_is_believed():
    measured = draw(4).abs()
    given = weights("softmin", measured, all_rendered=False)
    torch.testing.assert_close(given, torch.linspace(0.2, 1.0, 4, dtype=torch.float64))


@pytest.mark.parametrize("weighting", ["softmin", "probability"])
def test_softmin_sums_to_the_number_of_hypotheses_and_prefers_small_losses(weighting):
    measured = draw(8, seed=3).abs() + 0.1
    given = weights(weighting, measured, all_rendered=True).reshape(2, 4)
    torch.testing.assert_close(given.sum(dim=1), torch.full((2,), 4.0, dtype=torch.float64))
    for row, losses in zip(given, measured.reshape(2, 4), strict=True):
        assert row.argsort().tolist() == losses.argsort(descending=True).tolist()
        mean = float(losses.mean())
        exact = [math.exp(-float(loss) / mean / 0.5) for loss in losses]
        assert row.tolist() == pytest.approx([4 * e / sum(exact) for e in exact])


def test_softmin_does_not_depend_on_the_scale_of_losses():
    measured = draw(8, seed=4).abs() + 0.1
    first = weights("softmin", measured, all_rendered=True)
    torch.testing.assert_close(first, weights("softmin", measured * 1000, all_rendered=True))
    flat = weights("softmin", torch.zeros(4, dtype=torch.float64), all_rendered=True)
    torch.testing.assert_close(flat, torch.ones(4, dtype=torch.float64))


# --- adversary -------------------------------------------------------------------------------------------------------


def test_adversarial_terms_are_binary_cross_entropies():
    real, fake = draw(5, 1, seed=5), draw(5, 1, seed=6)
    one, zero = torch.ones_like(real), torch.zeros_like(real)
    bce = F.binary_cross_entropy_with_logits
    torch.testing.assert_close(adversarial_loss(fake), bce(fake, one))
    torch.testing.assert_close(discriminator_loss(real, fake), 0.5 * (bce(real, one) + bce(fake, zero)))
    assert float(discriminator_loss(zero, zero)) == pytest.approx(math.log(2))


def test_adversarial_gradients():
    logits = draw(3, 1, seed=7).requires_grad_(True)
    assert torch.autograd.gradcheck(adversarial_loss, logits)
    assert torch.autograd.gradcheck(lambda x: discriminator_loss(x, 2 * x), logits)


def test_gradient_penalty_against_finite_differences_and_its_own_gradient():
    first, second = draw(6, 4, seed=8), draw(4, 1, seed=9)

    def network(inputs, weight):
        return torch.tanh(inputs @ weight) @ second

    samples = draw(3, 6, seed=10)
    slow = 0.0
    for sample in samples:
        for k in range(6):
            step = torch.zeros(6, dtype=torch.float64)
            step[k] = 1e-5
            slow += float((network(sample + step, first) - network(sample - step, first)) / 2e-5) ** 2 / 3

    def penalty(weight):
        inputs = samples.clone().requires_grad_(True)
        return gradient_penalty(network(inputs, weight), inputs)

    assert penalty(first).item() == pytest.approx(slow, rel=1e-6)
    assert torch.autograd.gradcheck(penalty, first.clone().requires_grad_(True))


def test_gradient_penalty_adds_over_inputs():
    one, two = (draw(2, 3, seed=s).requires_grad_(True) for s in (11, 12))
    both = gradient_penalty((one.square() + 3 * two).sum(dim=1, keepdim=True), one, two)
    assert float(both) == pytest.approx(float((4 * one.square()).sum(dim=1).mean() + 27))


def test_side_view_prior_prefers_the_side_and_leaves_the_front_alone():
    degrees = torch.tensor([0.0, 30, 60, 70, 80, 90, 100, 110, 150, 180], dtype=torch.float64, requires_grad=True)
    turn = torch.deg2rad(degrees)
    zero = torch.zeros_like(turn)
    forward = torch.stack((turn.sin(), zero, turn.cos()), dim=1)
    rotations = torch.stack((forward.roll(1, dims=1), forward.roll(2, dims=1), forward), dim=2)
    loss = side_view_loss(rotations)
    expected = [1 - math.exp(-(math.cos(math.radians(d)) ** 2) / (2 * SIDE_SPREAD**2)) for d in degrees.tolist()]
    assert loss.tolist() == pytest.approx(expected)
    assert loss.argmin() == 5
    assert float(loss[5]) == pytest.approx(0.0, abs=1e-12)
    (slope,) = torch.autograd.grad(loss.sum(), degrees)
    assert (slope[2:5] < 0).all()
    assert (slope[6:8] > 0).all()
    assert slope[[0, 1, 8, 9]].abs().max() < 0.15 * slope.abs().max()
    assert torch.autograd.gradcheck(side_view_loss, rotations.detach().requires_grad_())
