import pytest
import torch
from torch.nn import functional as F

from fauna.discriminator.mask import MaskDiscriminator
from fauna.errors import FaunaError


def network(size: int = 32, condition_dim: int = 3) -> MaskDiscriminator:
    torch.manual_seed(0)
    return MaskDiscriminator(condition_dim=condition_dim, image_size=size, base_channels=4)


def masks(size: int = 32, batch: int = 2) -> torch.Tensor:
    return torch.rand(batch, size, size, generator=torch.Generator().manual_seed(0))


def slow(net: MaskDiscriminator, images: torch.Tensor, condition: torch.Tensor) -> torch.Tensor:
    """The network on the concatenation of mask and a constant image of the code."""
    batch, height, width = images.shape
    code = condition.expand(batch, -1)[:, :, None, None].expand(-1, -1, height, width)
    hidden = torch.cat((images[:, None], code), dim=1)
    for layer in (net.first, *net.layers):
        hidden = F.leaky_relu(layer(hidden), 0.2)
    return net.logit(hidden).flatten()


def test_size_and_shape_of_the_published_network():
    net = MaskDiscriminator(condition_dim=128, image_size=256, base_channels=16)
    assert sum(p.numel() for p in net.parameters()) == 2_834_688
    assert len(net.layers) == 5


@pytest.mark.parametrize("shared", [True, False])
def test_equals_the_concatenation(shared):
    net = network()
    condition = torch.randn(2, 3, generator=torch.Generator().manual_seed(1))
    condition = condition[0] if shared else condition
    torch.testing.assert_close(net(masks(), condition), slow(net, masks(), condition.reshape(-1, 3)))


@pytest.mark.parametrize("size", [64, 96, 128])
def test_other_sizes(size):
    assert network(size)(masks(size), torch.zeros(3)).shape == (2,)


def test_gradient_penalty_equals_that_of_the_concatenation():
    net = network()
    grads = []
    for forward in (net, lambda images, code: slow(net, images, code[None])):
        images = masks().requires_grad_()
        (grad,) = torch.autograd.grad(forward(images, torch.ones(3)).sum(), images, create_graph=True)
        grads.append(torch.autograd.grad(grad.square().sum(), list(net.parameters())))
    for ours, theirs in zip(*grads, strict=True):
        torch.testing.assert_close(ours, theirs)


def test_the_network_learns_to_tell_discs_from_noise():
    net = network()
    optimizer = torch.optim.Adam(net.parameters(), lr=1e-2)
    axis = torch.linspace(-1, 1, 32)
    disc = ((axis[:, None] ** 2 + axis**2) < 0.5).float()
    images = torch.stack((disc, masks()[0].round(), disc, masks()[1].round()))
    target = torch.tensor([1.0, 0.0, 1.0, 0.0])
    for _ in range(30):
        optimizer.zero_grad()
        F.binary_cross_entropy_with_logits(net(images, torch.zeros(3)), target).backward()
        optimizer.step()
    assert torch.equal((net(images, torch.zeros(3)) > 0).float(), target)


def test_wrong_sizes_are_refused():
    with pytest.raises(FaunaError, match="expects 32x32 masks, got 16x16"):
        network()(masks(16), torch.zeros(3))
    for size in (0, 4, 100):
        with pytest.raises(FaunaError, match=f"got {size}; use 64"):
            network(size)
