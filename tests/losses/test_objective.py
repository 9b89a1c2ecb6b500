"""How terms, rows and weights become one number."""

from dataclasses import replace

import pytest
import torch

from fauna.losses import objective as module
from fauna.losses.objective import IMAGE_TERMS, Objective, image_terms
from fauna.stages import Stage
from fauna.types import (
    BankReadout,
    BaseShape,
    Batch,
    Camera,
    Hypotheses,
    InstanceShape,
    Light,
    Pose,
    PosedMesh,
    Reconstruction,
    Renders,
    Selection,
    Shading,
)

PHOTOS, HYPOTHESES, SIZE, VERTS = 2, 4, 8, 5
ALL = {"mask": 2.0, "mask_spill": 3.0, "mask_miss": 4.0, "image": 5.0, "feature": 6.0}


def draw(*shape: int, seed: int) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


def photos() -> Batch:
    mask = torch.zeros(PHOTOS, SIZE, SIZE)
    mask[:, 1:7, 1:7] = 1
    shape = (PHOTOS, SIZE, SIZE)
    return Batch(
        images=draw(PHOTOS, 3, SIZE, SIZE, seed=0),
        masks=mask,
        distance_inside=draw(*shape, seed=1),
        distance_outside=draw(*shape, seed=2),
        valid=torch.ones(shape),
        category=0,
        names=("a", "b"),
    )


def targets() -> torch.Tensor:
    return draw(PHOTOS, 3, 4, 4, seed=3)


def shading(rows: int) -> Shading:
    pixels = torch.arange(rows * SIZE * SIZE)
    colours = draw(len(pixels), 6, seed=8)
    return Shading(pixels, pixels // SIZE**2, colours[:, :3], colours[:, 3:], 1.0)


def reconstruction(rows: int) -> Reconstruction:
    every = torch.arange(PHOTOS * HYPOTHESES)
    photo, chosen = (every // 4, every % 4) if rows == 8 else (torch.arange(PHOTOS), torch.tensor([2, 1]))
    predicted = draw(PHOTOS, HYPOTHESES, seed=4).requires_grad_(True)
    eye = torch.eye(4).expand(rows, 4, 4)
    verts = draw(VERTS, 3, seed=5)
    faces = torch.tensor([[0, 1, 2]])
    silhouette = draw(rows, SIZE, SIZE, seed=6).requires_grad_(True)
    return Reconstruction(
        readout=BankReadout(torch.zeros(PHOTOS, 2)),
        code=torch.zeros(2),
        base=BaseShape(verts, faces),
        instance=InstanceShape(verts.expand(PHOTOS, -1, -1), draw(PHOTOS, VERTS, 3, seed=7)),
        hypotheses=Hypotheses(
            torch.eye(3).expand(PHOTOS, HYPOTHESES, 3, 3),
            torch.zeros(PHOTOS, 3),
            predicted,
            torch.softmax(-predicted, dim=1),
        ),
        selection=Selection(photo, chosen),
        camera=Camera(eye, eye),
        posed=PosedMesh(verts.expand(rows, -1, -1), faces, verts),
        renders=Renders(silhouette, silhouette > 0.5, shading(rows)),
        light=Light(torch.zeros(rows, 3), torch.zeros(rows), torch.zeros(rows)),
        pose=Pose(draw(rows, 20, 3, seed=10)),
    )


def objective(weighting: str = "uniform") -> Objective:
    return Objective(weighting=weighting, articulation_norm="vector", softmin_temperature=None)


def stage(**weights: float) -> Stage:
    return Stage(weights=weights, target_weights={"mask": 10.0, "feature": 500.0}, temperature=0.5)


@pytest.mark.parametrize("rows", [2, 8])
def test_total_is_the_weighted_sum_of_the_terms(rows):
    now = stage(**ALL, hypothesis=7.0, articulation=8.0, deformation=9.0, eikonal=10.0)
    losses = objective()(photos(), targets(), reconstruction(rows), now, {"eikonal": torch.tensor(0.3)})
    assert set(losses.terms) == {*IMAGE_TERMS, "hypothesis", "articulation", "deformation", "eikonal"}
    torch.testing.assert_close(losses.total, sum(now.weight(name) * value for name, value in losses.terms.items()))
    per_row = image_terms(photos(), targets(), reconstruction(rows), now)
    for name in IMAGE_TERMS:
        torch.testing.assert_close(losses.terms[name], per_row[name].mean())


@pytest.mark.parametrize(("weighting", "rows"), [("softmin", 8), ("probability", 2), ("probability", 8)])
def test_rows_are_weighted_before_the_mean(weighting, rows):
    losses = objective(weighting)(photos(), targets(), reconstruction(rows), stage(mask=1.0), {})
    per_row = image_terms(photos(), targets(), reconstruction(rows), stage(mask=1.0))["mask"]
    torch.testing.assert_close(losses.terms["mask"], (per_row * losses.weights).mean())
    assert not torch.equal(losses.weights, torch.ones(rows))
    assert not losses.weights.requires_grad


def test_measured_uses_target_weights_and_is_detached():
    out = reconstruction(8)
    losses = objective()(photos(), targets(), out, stage(hypothesis=1.0), {})
    per_row = image_terms(photos(), targets(), out, stage())
    torch.testing.assert_close(losses.measured, 10 * per_row["mask"] + 500 * per_row["feature"])
    losses.total.backward()
    assert (
        out.renders.silhouette.grad is None
    )  # terms of weight 0 do not enter the sum, so nothing of theirs can poison it
    assert out.hypotheses.predicted_losses.grad.abs().min() > 0


def test_a_rows_measurement_belongs_to_its_own_photo_and_hypothesis():
    out = reconstruction(2)
    losses = objective()(photos(), targets(), out, stage(hypothesis=1.0), {})
    losses.total.backward()
    touched = out.hypotheses.predicted_losses.grad != 0
    assert touched.nonzero().tolist() == [[0, 2], [1, 1]]


@pytest.mark.parametrize("name", IMAGE_TERMS)
def test_a_term_without_weight_is_not_computed(monkeypatch, name):
    def never(*_):
        raise AssertionError("computed for nothing")

    monkeypatch.setattr(module, f"{name}_loss", never)
    others = {other: weight for other, weight in ALL.items() if other != name}
    now = Stage(weights={**others, name: 0.0}, target_weights={other: 1.0 for other in others})
    assert name not in objective()(photos(), targets(), reconstruction(8), now, {}).terms
    with pytest.raises(AssertionError, match="for nothing"):
        objective()(photos(), targets(), reconstruction(8), replace(now, weights=ALL), {})


def test_regularisers_without_weight_or_subject_are_left_out():
    out = reconstruction(2)
    assert set(objective()(photos(), targets(), out, stage(mask=1.0), {}).terms) == {"mask", "feature", "hypothesis"}
    bare = replace(out, pose=None, instance=InstanceShape(out.instance.verts))
    terms = objective()(photos(), targets(), bare, stage(articulation=1.0, deformation=1.0), {}).terms
    assert not {"articulation", "deformation"} & set(terms)


def test_temperature_of_the_softmin_can_be_set_apart():
    hot = Objective(weighting="softmin", articulation_norm="vector", softmin_temperature=100.0)
    cold = Objective(weighting="softmin", articulation_norm="vector", softmin_temperature=0.01)
    flat, sharp = (o(photos(), targets(), reconstruction(8), stage(), {}).weights for o in (hot, cold))
    torch.testing.assert_close(flat, torch.ones(8), atol=0.02, rtol=0)
    assert sharp.max() > 2
