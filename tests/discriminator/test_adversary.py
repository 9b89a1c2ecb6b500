"""The rules of the adversarial game."""

import pytest
import torch
from torch import nn

from fauna.configuration import validate
from fauna.discriminator.adversary import Adversary, MaskPair, _one_row_per_photo
from fauna.errors import FaunaError
from fauna.losses.adversarial import discriminator_loss
from fauna.types import Hypotheses, Selection
from tests.runs import composed


class Critic(nn.Module):
    """A weighted sum of pixels and condition."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.linspace(-1, 1, 9).reshape(3, 3))

    def forward(self, masks, condition):
        return (masks.square() * self.weight).sum(dim=(1, 2))[:, None] + condition.sum()


def adversary(penalty: float = 4.0) -> Adversary:
    return Adversary(network=Critic(), random_view="predicted", real_masks="observed", penalty=penalty)


def pair() -> MaskPair:
    generator = torch.Generator().manual_seed(0)
    real, fake = (torch.rand(2, 3, 3, generator=generator) for _ in range(2))
    return MaskPair(real, fake, torch.tensor([0.1, 0.2]))


def test_discriminator_loss_adds_half_the_weighted_penalty_at_real_masks():
    game, masks = adversary(), pair()
    terms = game.discriminator_loss(masks)
    slope = 2 * masks.real * game.network.weight.detach()
    penalty = slope.square().sum(dim=(1, 2)).mean()
    torch.testing.assert_close(terms["gradient_penalty"], penalty)
    logits = [game.network(each, masks.condition) for each in (masks.real, masks.fake)]
    torch.testing.assert_close(terms["discriminator"], discriminator_loss(*logits) + 2.0 * penalty)
    assert not terms["gradient_penalty"].requires_grad


def test_penalty_takes_part_in_the_gradient():
    grads = []
    for weight in (0.0, 4.0):
        game = adversary(weight)
        game.discriminator_loss(pair())["discriminator"].backward()
        grads.append(game.network.weight.grad)
    masks = pair()
    extra = 2.0 * (2 * 4 * masks.real.square() * Critic().weight.detach()).mean(dim=0)  # d/dw of 2 mean (2 x w)^2
    torch.testing.assert_close(grads[1] - grads[0], extra)


@pytest.mark.parametrize(("key", "value"), [("random_view", "sideways"), ("real_masks", "imagined")])
def test_unknown_rules_are_named(key, value):
    with pytest.raises(FaunaError, match=f"discriminator.{key}: expected one of .* got '{value}'"):
        validate(composed(f"discriminator.{key}={value}"))


def test_most_probable_rendered_row_of_each_photo():
    probabilities = torch.tensor([[0.1, 0.6, 0.2, 0.1], [0.3, 0.1, 0.1, 0.5], [0.4, 0.2, 0.3, 0.1]])
    hypotheses = Hypotheses(torch.eye(3).expand(3, 4, 3, 3), torch.zeros(3, 3), -probabilities, probabilities)
    every = torch.arange(12)

    class Out:
        pass

    out = Out()
    out.hypotheses = hypotheses
    out.selection = Selection(every // 4, every % 4)
    assert _one_row_per_photo.__wrapped__(out).tolist() == [1, 7, 8]
    out.selection = Selection(torch.arange(3), torch.tensor([3, 0, 2]))
    assert _one_row_per_photo.__wrapped__(out).tolist() == [0, 1, 2]
