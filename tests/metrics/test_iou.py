import torch

from fauna.metrics.iou import silhouette_iou


def slow_iou(first, second):
    both = union = 0
    for a, b in zip(first.flatten().tolist(), second.flatten().tolist(), strict=True):
        both += a > 0.5 and b > 0.5
        union += a > 0.5 or b > 0.5
    return both / union if union else 1.0


def test_equals_a_loop():
    generator = torch.Generator().manual_seed(0)
    silhouette, mask = torch.rand(5, 6, 7, generator=generator), torch.rand(5, 6, 7, generator=generator)
    expected = [slow_iou(s, m) for s, m in zip(silhouette, mask, strict=True)]
    torch.testing.assert_close(silhouette_iou(silhouette, mask), torch.tensor(expected))


def test_limits():
    empty, full = torch.zeros(1, 3, 3), torch.ones(1, 3, 3)
    assert silhouette_iou(empty, empty) == 1
    assert silhouette_iou(full, full) == 1
    assert silhouette_iou(full, empty) == silhouette_iou(empty, full) == 0
    assert silhouette_iou(full * 0.5, full) == 0
