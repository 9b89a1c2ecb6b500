import pytest
import torch

from fauna.shape.template import TemplateShape

CODE = torch.zeros(4)


def template(learnable_scale=False):
    return TemplateShape(
        radii=(0.6, 0.6, 1.5), leg_length=1.4, leg_radius=0.25, cell_size=0.2, learnable_scale=learnable_scale
    )


def test_closed_symmetric_and_outward():
    base = template()(CODE, None)
    directed = torch.cat([base.faces[:, [i, (i + 1) % 3]] for i in range(3)])
    unique, counts = torch.unique(directed, dim=0, return_counts=True)
    assert (counts == 1).all()
    assert torch.equal(torch.unique(unique.flip(1), dim=0), unique)
    assert torch.linalg.det(base.verts[base.faces]).sum() > 0
    assert sorted((base.verts * torch.tensor([-1.0, 1.0, 1.0])).tolist()) == sorted(base.verts.tolist())


def test_has_four_legs_of_the_given_length():
    verts = template()(CODE, None).verts
    assert verts[:, 1].min().item() == pytest.approx(-1.4, abs=0.05)
    feet = verts[verts[:, 1] < -1.0]
    quadrants = {(x > 0, z > 0) for x, _, z in feet.tolist()}
    assert len(quadrants) == 4
    assert verts[:, 2].max().item() == pytest.approx(1.5, abs=0.05)
    assert feet[:, 0].abs().min() > 0.03


def test_scale_is_learnable_on_request():
    model = template(learnable_scale=True)
    model(CODE, None).verts.square().sum().backward()
    assert model.log_scale.grad.min() > 0
    assert not any(p.requires_grad for p in template().parameters())


def test_keeps_the_interface_of_a_learned_shape():
    model = template()
    base, stats = model.extract(CODE, None)
    assert stats.evaluations > 0
    assert model.eikonal(CODE, base, torch.Generator()) == 0
    assert model.audit(CODE, None) == 0
    model.set_resolution(128)
    assert model.grid_resolution == 128
