import math
from dataclasses import replace

import numpy as np
import pytest

from fauna.reconstruct.quality import Measures, confidence, judge, measure
from fauna.reconstruct.settings import default_settings

SETTINGS = default_settings().quality
ANIMAL, THING = Measures(0.8, 0.0, 0.25, 1.4, 1.4), Measures(0.7, 0.1, 0.15, 2.1, 1.2)


def test_confidence_is_a_probability_that_rises_with_overlap_and_falls_with_strangeness():
    assert confidence(ANIMAL, SETTINGS) > 0.8 > 0.2 > confidence(THING, SETTINGS)
    values = [confidence(replace(ANIMAL, iou=iou), SETTINGS) for iou in np.linspace(0, 1, 9)]
    assert values == sorted(values)
    values = [confidence(replace(ANIMAL, strangeness=strange), SETTINGS) for strange in (0.0, 1.0, 2.0, 1e9)]
    assert values == sorted(values, reverse=True)
    assert all(0.0 <= value <= 1.0 for value in values)
    values = [confidence(replace(ANIMAL, distinctness=distinct), SETTINGS) for distinct in (0.0, 0.9, 1.4, 1e9)]
    assert values == sorted(values)
    nothing = replace(SETTINGS, bias=0.0, iou=0.0, strangeness=0.0, distinctness=0.0)
    assert confidence(Measures(0.5, 0.0, None, 1.5, 1.0), nothing) == 0.5


def test_the_verdict_follows_confidence():
    assert judge(ANIMAL, SETTINGS) == ("ok", "")
    status, reason = judge(THING, SETTINGS)
    assert status == "not_a_quadruped"
    assert "strangeness 2.1, distinctness 1.2" in reason
    assert judge(THING, replace(SETTINGS, quadruped=0.0))[0] == "ok"


def test_what_is_measured(loaded, drawn):
    fit = loaded.reconstruct(drawn[0], mask=drawn[1]).fit
    mask, silhouette = fit.batch.masks[0].numpy(), fit.out.renders.silhouette[0].numpy()
    found = measure(fit.model, fit.batch, fit.out)
    assert found.iou == pytest.approx(np.minimum(mask, silhouette).sum() / np.maximum(mask, silhouette).sum(), abs=1e-5)
    shares = fit.out.hypotheses.probabilities[0].double().numpy() + 1e-300
    assert found.ambiguity == pytest.approx(-(shares * np.log(shares)).sum() / math.log(4), abs=1e-6)
    assert -1.0 <= found.similarity <= 1.0
    assert 0.5 < found.strangeness < 1.5
    space, features = fit.model.feature_space, fit.model.encode(fit.batch)
    local = (features.tokens[0] - space.token_mean[:, None, None]) / space.token_std[:, None, None]
    grid = mask.reshape(local.shape[1], -1, local.shape[2], mask.shape[1] // local.shape[2]).mean(axis=(1, 3))
    expected = np.sqrt((local.square().mean(dim=0).numpy() * grid).sum() / grid.sum())
    assert found.distinctness == pytest.approx(expected, rel=1e-4)


def test_confidence_of_other_weights_is_said_to_be_uncalibrated(loaded, drawn):
    assert "confidence_not_calibrated" not in loaded.reconstruct(drawn[0], mask=drawn[1]).flags
    other = replace(loaded, weights=replace(loaded.weights, sha256="0" * 64))
    assert "confidence_not_calibrated" in other.reconstruct(drawn[0], mask=drawn[1]).flags


def test_a_drawn_animal_is_one_and_a_drawn_star_is_none(loaded, drawn):
    assert loaded.reconstruct(drawn[0], mask=drawn[1]).status == "ok"
    rows, columns = np.mgrid[-128:128, -128:128]
    radius = 60 + 40 * np.cos(5 * np.arctan2(rows, columns))
    star = np.hypot(rows, columns) < radius
    image = np.where(star[..., None], (250, 220, 20), (20, 40, 90)).astype(np.uint8)
    result = loaded.reconstruct(image, mask=star)
    assert result.status == "not_a_quadruped"
    assert result.fit is not None  # written all the same: the rule errs
    assert "confidence" in result.reason
