"""Image losses against loops over pixels."""

import pytest
import torch

from fauna.losses.reconstruction import (
    eroded_intersection,
    feature_loss,
    image_loss,
    mask_loss,
    mask_miss_loss,
    mask_spill_loss,
    upsample,
    values_at,
)

ROWS, SIZE = 2, 5


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def pixels():
    return [(i, j) for i in range(SIZE) for j in range(SIZE)]


def test_mask_terms_equal_loops():
    silhouette, mask, valid = (draw(ROWS, SIZE, SIZE, seed=s) for s in range(3))
    mask, valid = (mask > 0.5).double(), (valid > 0.2).double()
    for row in range(ROWS):
        s, m, v = silhouette[row], mask[row], valid[row]
        plain = sum((s[p] * v[p] - m[p]) ** 2 for p in pixels()) / SIZE**2
        spill = sum(s[p] * m[p] for p in pixels()) / SIZE**2
        miss = sum((1 - s[p]) * m[p] for p in pixels()) / SIZE**2
        torch.testing.assert_close(mask_loss(silhouette, mask, valid)[row], plain)
        torch.testing.assert_close(mask_spill_loss(silhouette, mask)[row], spill)
        torch.testing.assert_close(mask_miss_loss(silhouette, mask)[row], miss)


def listed(*images: torch.Tensor) -> list[torch.Tensor]:
    """Images (row, chan, size, size) as lists of all their pixels (pixel, chan)."""
    return [image.movedim(1, -1).reshape(-1, image.shape[1]) for image in images]


def everywhere(region: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, int, int]:
    """Weight and row of all pixels, number of rows, pixels of an image."""
    area = region[0].numel()
    return region.reshape(-1), torch.arange(ROWS).repeat_interleave(area), ROWS, area


def test_colour_terms_equal_loops_and_divide_by_the_whole_image():
    rendered, observed = draw(ROWS, 3, SIZE, SIZE, seed=3), draw(ROWS, 3, SIZE, SIZE, seed=4)
    region = (draw(ROWS, SIZE, SIZE, seed=5) > 0.6).double()
    lists, where = listed(rendered, observed), everywhere(region)
    for row in range(ROWS):
        inside = [(c, *p) for c in range(3) for p in pixels() if region[row][p]]
        l1 = sum(abs(rendered[row][q] - observed[row][q]) for q in inside) / (3 * SIZE**2)
        l2 = sum((rendered[row][q] - observed[row][q]) ** 2 for q in inside) / (3 * SIZE**2)
        torch.testing.assert_close(image_loss(*lists, *where)[row], l1)
        torch.testing.assert_close(feature_loss(*lists, *where)[row], l2)


def test_perfect_and_empty_predictions():
    mask = torch.zeros(1, SIZE, SIZE, dtype=torch.float64)
    mask[0, 1:4, 1:4] = 1
    depth, valid = mask * draw(1, SIZE, SIZE), torch.ones_like(mask)
    assert mask_loss(mask, mask, valid) == 0
    assert mask_miss_loss(mask, depth) == 0
    assert mask_spill_loss(mask, 1 - mask) == 0
    empty = torch.zeros_like(mask)
    torch.testing.assert_close(mask_miss_loss(empty, depth)[0], depth.mean())
    torch.testing.assert_close(mask_loss(empty, mask, valid)[0], mask.mean())
    assert mask_spill_loss(empty, 1 - mask) == 0


def test_what_lies_outside_the_photo_is_no_error_of_the_silhouette():
    silhouette, mask, valid = torch.ones(1, 2, 2), torch.zeros(1, 2, 2), torch.zeros(1, 2, 2)
    assert mask_loss(silhouette, mask, valid) == 0
    assert mask_loss(silhouette, mask, valid + 1) == 1


def test_erosion_leaves_one_pixel_of_three_by_three():
    both = torch.zeros(1, 7, 7)
    both[0, 2:5, 3:6] = 1
    region = eroded_intersection(both, both, torch.ones_like(both))
    assert region.nonzero().tolist() == [[0, 3, 4]]


def test_erosion_excludes_the_image_border_and_needs_all_three_inputs():
    full = torch.ones(1, 6, 6)
    assert eroded_intersection(full, full, full).sum() == 16
    assert eroded_intersection(full, full, full)[0, 0].sum() == 0
    for position in range(3):
        inputs = [full.clone() for _ in range(3)]
        inputs[position][0, 3, 3] = 0
        assert eroded_intersection(*inputs).sum() == 16 - 9


def test_erosion_counts_any_silhouette_but_only_more_than_half_a_mask():
    full = torch.ones(1, 3, 3)
    assert eroded_intersection(full * 1e-3, full, full).sum() == 1
    assert eroded_intersection(full, full * 0.5, full).sum() == 0
    silhouette = full.clone().requires_grad_(True)
    assert not eroded_intersection(silhouette, full, full).requires_grad


@pytest.mark.parametrize("loss", [mask_spill_loss, mask_miss_loss])
def test_gradients_of_distance_terms(loss):
    inputs = draw(ROWS, 3, 3, seed=6).requires_grad_(True)
    assert torch.autograd.gradcheck(lambda s: loss(s, draw(ROWS, 3, 3, seed=7)), inputs)


@pytest.mark.parametrize("loss", [image_loss, feature_loss])
def test_gradients_of_colour_terms(loss):
    where = everywhere((draw(ROWS, 3, 3, seed=8) > 0.3).double())
    rendered = draw(ROWS * 9, 2, seed=9).requires_grad_(True)
    assert torch.autograd.gradcheck(lambda r: loss(r, draw(ROWS * 9, 2, seed=10), *where), rendered)


def test_values_at_looks_into_the_photos_of_the_pixels():
    maps, pixels = draw(3, 2, 4, 4, seed=14), torch.tensor([5, 16 + 5, 2 * 16 + 15])
    found = values_at(maps, torch.tensor([2, 0, 1]), pixels)  # rows need not be photos
    assert torch.equal(found, torch.stack((maps[2, :, 1, 1], maps[0, :, 1, 1], maps[1, :, 3, 3])))


def test_gradient_of_the_mask_term():
    mask, valid = (draw(ROWS, 3, 3, seed=s).round() for s in (11, 12))
    silhouette = draw(ROWS, 3, 3, seed=13).requires_grad_(True)
    assert torch.autograd.gradcheck(lambda s: mask_loss(s, mask, valid), silhouette)


def test_upsampling_centres_pixels():
    ramp = torch.arange(4.0).expand(1, 1, 4, 4)
    assert upsample(ramp, 4, 4) is ramp
    wide = upsample(ramp, 8, 8)[0, 0, 0]
    torch.testing.assert_close(wide, torch.tensor([0, 0.25, 0.75, 1.25, 1.75, 2.25, 2.75, 3.0]))
