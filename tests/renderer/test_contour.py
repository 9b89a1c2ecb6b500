"""Blending lists of pixels against blending whole images."""

import pytest
import torch

from fauna.geometry.mesh import build_topology
from fauna.renderer.contour import blend_at, blend_coverage

SIZE, ROWS = 24, 2


@pytest.fixture
def scene(blob, project):
    verts, faces = blob(8)
    return project(verts, ROWS), faces, build_topology(faces)


def test_coverage_equals_the_silhouette(renderer, scene):
    clip, faces, topology = scene
    fragments = renderer.rasterize(clip, faces, SIZE, SIZE)
    found = blend_coverage(fragments.covered, renderer.contour(fragments, clip, faces, topology))
    torch.testing.assert_close(found, renderer.silhouette(clip, faces, SIZE, SIZE, topology))
    assert ((found > 0.01) & (found < 0.99)).any()


@pytest.mark.parametrize("listed", ["covered", "some"])
def test_blending_a_list_equals_blending_the_image(renderer, scene, listed):
    clip, faces, topology = scene
    clip = clip.requires_grad_()
    fragments = renderer.rasterize(clip, faces, SIZE, SIZE)
    generator = torch.Generator().manual_seed(0)
    pixels = fragments.covered.reshape(-1).clone()
    if listed == "some":
        pixels &= torch.rand(pixels.shape, generator=generator) < 0.6
    pixels = pixels.nonzero()[:, 0]
    values = torch.rand(len(pixels), 3, generator=generator, dtype=torch.float64).requires_grad_()
    dense = torch.zeros(ROWS * SIZE * SIZE, 3, dtype=torch.float64).index_copy(0, pixels, values)
    image = dense.reshape(ROWS, SIZE, SIZE, 3).movedim(-1, 1).contiguous()
    expected = renderer.antialias(image, fragments, clip, faces, topology).movedim(1, -1).reshape(-1, 3)[pixels]
    contour = renderer.contour(fragments, clip, faces, topology)
    found = blend_at(values, pixels, contour, ROWS * SIZE * SIZE)
    assert not torch.equal(found, values)
    torch.testing.assert_close(found, expected)
    weight = torch.rand(found.shape, generator=generator, dtype=torch.float64)
    for one, other in zip(
        torch.autograd.grad((found * weight).sum(), (clip, values), retain_graph=True),
        torch.autograd.grad((expected * weight).sum(), (clip, values)),
        strict=True,
    ):
        torch.testing.assert_close(one, other)


def test_no_contour_and_no_pixel_are_no_problem(renderer, scene):
    clip, faces, topology = scene
    fragments = renderer.rasterize(clip + torch.tensor([1e4, 0.0, 0.0, 0.0]), faces, SIZE, SIZE)  # out of sight
    contour = renderer.contour(fragments, clip + torch.tensor([1e4, 0.0, 0.0, 0.0]), faces, topology)
    assert blend_coverage(fragments.covered, contour).sum() == 0
    empty = torch.zeros(0, 3, dtype=torch.float64)
    assert blend_at(empty, torch.zeros(0, dtype=torch.long), contour, ROWS * SIZE * SIZE).shape == (0, 3)
