"""The networks see the mask in parts of feature cells."""

import pytest
import torch

from fauna.encoder.mask_embedding import MaskEmbedding, NoMaskEmbedding
from fauna.types import Features


def features(batch: int = 2) -> Features:
    maps = torch.randn(2, batch, 5, 4, 4, generator=torch.Generator().manual_seed(0))
    return Features(torch.zeros(batch, 3), maps[0], maps[1])


def test_none_changes_nothing():
    given = features()
    assert NoMaskEmbedding()(given, torch.ones(2, 8, 8)) is given


def test_a_cell_sees_its_own_part_of_the_mask():
    torch.manual_seed(0)
    module, given = MaskEmbedding(key_dim=5, subcells=2), features()
    masks = torch.rand(2, 8, 8, generator=torch.Generator().manual_seed(1))
    seen = module(given, masks)
    assert seen.tokens is given.tokens
    assert seen.global_ is given.global_
    weight = module.project.weight[:, :, 0, 0]  # (key, part), parts row by row
    for row in range(4):
        for column in range(4):
            part = masks[:, 2 * row : 2 * row + 2, 2 * column : 2 * column + 2].flatten(1) - 0.5
            torch.testing.assert_close(seen.keys[..., row, column], given.keys[..., row, column] + part @ weight.T)


@pytest.mark.parametrize("side", [16, 24])
def test_other_resolutions_are_averaged(side):
    module, given = MaskEmbedding(key_dim=5, subcells=2), features(batch=1)
    coarse = torch.rand(1, 8, 8, generator=torch.Generator().manual_seed(2))
    fine = coarse.repeat_interleave(side // 8, dim=1).repeat_interleave(side // 8, dim=2)
    torch.testing.assert_close(module(given, fine).keys, module(given, coarse).keys)


def test_gradient_reaches_the_projection():
    module = MaskEmbedding(key_dim=5, subcells=2)
    module(features(), torch.rand(2, 8, 8)).keys.square().sum().backward()
    assert module.project.weight.grad is not None
    assert module.project.weight.grad.abs().sum() > 0
