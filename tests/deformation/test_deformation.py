import pytest
import torch

from fauna.deformation.field import DeformationField
from fauna.deformation.none import NoDeformation
from fauna.types import BaseShape


def field(mirror_x: bool, hidden_dim: int = 16, geometry_dim: int = 5, num_octaves: int = 2) -> DeformationField:
    torch.manual_seed(0)
    return DeformationField(
        geometry_dim=geometry_dim,
        num_octaves=num_octaves,
        base_frequency=0.8,
        num_layers=3,
        hidden_dim=hidden_dim,
        precision="float32",
        offset_scale=0.1,
        mirror_x=mirror_x,
    )


def base() -> BaseShape:
    half = torch.randn(10, 3, generator=torch.Generator().manual_seed(0)).abs() + 0.1
    middle = half * torch.tensor([0.0, 1.0, 1.0])
    verts = torch.cat((half, half * torch.tensor([-1.0, 1.0, 1.0]), middle))
    return BaseShape(verts, torch.tensor([[0, 1, 2]]))


def geometry(batch: int = 2) -> torch.Tensor:
    return torch.randn(batch, 5, generator=torch.Generator().manual_seed(1))


@pytest.mark.parametrize(("mirror_x", "sign"), [(True, -1.0), (False, 1.0)])
def test_symmetry_of_the_offsets(mirror_x, sign):
    instance = field(mirror_x)(base(), geometry())
    assert instance.offsets is not None
    right, left, middle = instance.offsets[:, :10], instance.offsets[:, 10:20], instance.offsets[:, 20:]
    torch.testing.assert_close(left, right * torch.tensor([sign, 1.0, 1.0]))
    assert (right[..., 0].abs() > 0).all()
    assert bool((middle[..., 0] == 0).all()) == mirror_x


def test_offsets_are_added_and_depend_on_the_photo_only_through_its_embedding():
    deformation = field(True)
    instance = deformation(base(), geometry())
    assert instance.offsets is not None
    torch.testing.assert_close(instance.verts, base().verts + instance.offsets)
    alone = deformation(base(), geometry()[1:])
    torch.testing.assert_close(alone.verts[0], instance.verts[1])
    assert (instance.verts[0] - instance.verts[1]).abs().max() > 1e-4


def test_gradient_reaches_base_and_embedding():
    shape, code = base(), geometry().requires_grad_()
    verts = shape.verts.requires_grad_()
    field(True)(BaseShape(verts, shape.faces), code).verts.square().sum().backward()
    assert verts.grad is not None
    assert code.grad is not None
    assert torch.isfinite(verts.grad).all()
    assert (code.grad.abs().sum(1) > 0).all()


def test_no_deformation_keeps_the_base():
    instance = NoDeformation()(base(), geometry())
    assert torch.equal(instance.verts, base().verts[None])
    assert instance.offsets is None
