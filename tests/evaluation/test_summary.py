"""Means over photos, then over species."""

import inspect

import pytest
import torch

from fauna.evaluation import summary as evaluation
from fauna.evaluation.summary import evaluate


class FakeModel(torch.nn.Module):
    """Its prediction is in the photo."""

    stage = None
    device = torch.device("cpu")

    def with_features(self, photo):
        return photo

    def feature_targets(self, photo):
        return None

    def forward(self, photo):
        assert not self.training
        return photo


class FakePhoto:
    def __init__(self, iou: float, loss: float) -> None:
        self.iou, self.loss = iou, loss
        self.renders = self
        self.silhouette = self.masks = None

    def to(self, device):
        assert device == FakeModel.device
        return self


@pytest.fixture(autouse=True)
def _fakes(monkeypatch):
    current = []

    def objective(photo, targets, out, stage, extra):
        current[:] = [photo]
        return type("Losses", (), {"terms": {"mask": torch.tensor(photo.loss)}})()

    monkeypatch.setattr(evaluation, "silhouette_iou", lambda silhouette, mask: torch.tensor([current[0].iou]))
    monkeypatch.setattr(evaluation, "fake_objective", objective, raising=False)
    monkeypatch.setattr(evaluation, "image_terms", inspect.unwrap(evaluation.image_terms))


@pytest.mark.usefixtures("_fakes")
def test_overall_is_the_mean_over_species_not_over_photos(monkeypatch):
    photos = [
        ("dog", FakePhoto(0.2, 1.0)),
        ("dog", FakePhoto(0.4, 3.0)),
        ("cat", FakePhoto(0.9, 8.0)),
        ("dog", FakePhoto(0.6, 5.0)),
    ]
    model = FakeModel().train()
    report = inspect.unwrap(evaluate)(model, evaluation.fake_objective, iter(photos))
    assert report["species"]["dog"]["iou"] == pytest.approx(0.4)
    assert report["species"]["dog"]["losses"] == {"mask": pytest.approx(3.0)}
    assert report["species"]["dog"]["num_photos"] == 3
    assert list(report["species"]) == ["cat", "dog"]
    assert report["iou"] == pytest.approx((0.4 + 0.9) / 2)
    assert report["losses"] == {"mask": pytest.approx(5.5)}
    assert report["num_photos"] == 4
    assert model.training


def test_no_photos_give_no_report():
    assert inspect.unwrap(evaluate)(FakeModel(), evaluation.fake_objective, iter(())) is None
