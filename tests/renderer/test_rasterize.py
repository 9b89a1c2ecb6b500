import math
import sys

import numpy as np
import pytest
import torch

from fauna.errors import FaunaError
from fauna.geometry.mesh import build_topology
from fauna.renderer import nvdiffrast_backend, torch_backend
from fauna.renderer.numba_backend import NumbaRenderer
from fauna.renderer.nvdiffrast_backend import NvdiffrastRenderer
from fauna.renderer.torch_backend import TorchRenderer

HEIGHT, WIDTH = 24, 32


def brute_force(clip, faces, height, width):
    """Face index and perspective-correct barycentrics (row, height, width[, 3]) by looping over everything."""
    clip, faces = clip.detach().double().numpy(), faces.numpy()
    ids, bary = np.full((len(clip), height, width), -1), np.zeros((len(clip), height, width, 3))
    nearest = np.full(ids.shape, np.inf)
    for row, i, j in np.ndindex(ids.shape):
        centre = np.array([(2 * j + 1) / width - 1, (2 * i + 1) / height - 1])
        for index, face in enumerate(faces):
            corners = clip[row, face]
            ndc = corners[:, :3] / corners[:, 3:]
            edges = np.stack([ndc[1, :2] - ndc[0, :2], ndc[2, :2] - ndc[0, :2]], axis=1)
            if abs(np.linalg.det(edges)) < 1e-12:
                continue
            b, c = np.linalg.solve(edges, centre - ndc[0, :2])
            flat = np.array([1 - b - c, b, c])  # weights on the screen
            if (flat < 0).any() or flat @ ndc[:, 2] >= nearest[row, i, j]:
                continue
            nearest[row, i, j], ids[row, i, j] = flat @ ndc[:, 2], index
            bary[row, i, j] = flat / corners[:, 3] / (flat / corners[:, 3]).sum()
    return torch.from_numpy(ids), torch.from_numpy(bary), torch.from_numpy(nearest)


def test_equals_brute_force(renderer, soup):
    clip, faces = soup(2, 25)
    fragments = renderer.rasterize(clip, faces, HEIGHT, WIDTH)
    ids, bary, depth = brute_force(clip, faces, HEIGHT, WIDTH)
    assert 0.2 < fragments.covered.double().mean() < 1
    assert torch.equal(fragments.face_index, ids)
    torch.testing.assert_close(fragments.barycentrics, bary, atol=1e-9, rtol=0)
    torch.testing.assert_close(fragments.depth, depth, atol=1e-4, rtol=0)  # positions are snapped to 1/65536 px


def test_closed_surface_has_no_gaps(renderer, blob, project):
    """A mask without pixels that disagree with a brute force in float64, for triangles smaller than pixels."""
    verts, faces = blob(6)
    clip = project(verts, 1).float()
    ids, _, _ = brute_force(clip, faces, HEIGHT, WIDTH)
    assert torch.equal(renderer.rasterize(clip, faces, HEIGHT, WIDTH).covered, ids >= 0)


def test_pixel_centres_on_shared_edges_are_covered(renderer):
    """A fan around a pixel centre, with edges running through rows, columns and diagonals of pixel centres."""
    centre = torch.tensor([[0.0, 0.0]]) + 1 / 8  # the centre of pixel (4, 4) of 8 x 8
    rim = torch.tensor([[math.cos(a), math.sin(a)] for a in torch.arange(0, 2 * math.pi, math.pi / 4).tolist()])
    points = torch.cat((centre, centre + 3 / 4 * (rim / rim.abs().amax(1, keepdim=True)).round(decimals=6)))
    clip = torch.cat((points, torch.zeros(9, 1), torch.ones(9, 1)), dim=1)[None]
    faces = torch.tensor([[0, k, k % 8 + 1] for k in range(1, 9)])
    covered = renderer.rasterize(clip, faces, 8, 8).covered[0]
    assert covered[1:8, 1:8].all()
    assert covered.sum() == 49


def test_negative_ndc_y_is_the_upper_half(renderer):
    clip = torch.tensor([[[-0.9, -0.9, 0, 1], [0.9, -0.9, 0, 1], [-0.9, -0.2, 0, 1.0]]])
    covered = renderer.rasterize(clip, torch.tensor([[0, 1, 2]]), 10, 10).covered[0]
    assert covered[:5].any()
    assert not covered[5:].any()
    assert covered[:, :5].sum() > covered[:, 5:].sum()


def test_interpolation_is_perspective_correct(renderer):
    """World coordinates of a tilted plane, interpolated, project back to the pixel they are seen at."""
    verts = torch.tensor([[-2.0, -1, -1], [2, -1, -9], [2, 3, -9], [-2, 3, -3]], dtype=torch.float64)
    clip = torch.stack((verts[:, 0], -verts[:, 1], -verts[:, 2] - 0.2, -verts[:, 2]), dim=1)[None]
    faces = torch.tensor([[0, 1, 2], [2, 3, 0]])
    fragments = renderer.rasterize(clip, faces, 16, 16)
    x, y, z = renderer.interpolate(fragments, faces, verts[None])[0]
    i, j = fragments.covered[0].nonzero(as_tuple=True)
    assert len(i) > 20
    torch.testing.assert_close((x / -z)[i, j], (2 * j.double() + 1) / 16 - 1, atol=1e-9, rtol=0)
    torch.testing.assert_close((-y / -z)[i, j], (2 * i.double() + 1) / 16 - 1, atol=1e-9, rtol=0)


def test_interpolate_at_selects_pixels_of_interpolate(renderer, soup):
    clip, faces = soup(2, 20)
    fragments = renderer.rasterize(clip, faces, HEIGHT, WIDTH)
    attributes = torch.rand(2, 60, 4, dtype=torch.float64)
    pixels = torch.tensor([5, 700, 5, 2 * HEIGHT * WIDTH - 1, 900])
    image = renderer.interpolate(fragments, faces, attributes)
    expected = image.movedim(1, -1).reshape(-1, 4)[pixels]
    torch.testing.assert_close(renderer.interpolate_at(fragments, faces, attributes, pixels), expected)
    assert (image.movedim(1, -1)[~fragments.covered] == 0).all()
    shared = renderer.interpolate(fragments, faces, attributes[:1])
    torch.testing.assert_close(shared, renderer.interpolate(fragments, faces, attributes[:1].expand(2, -1, -1)))


def test_gradients_of_interpolation(renderer, soup):
    clip, faces = soup(2, 16)
    clip.requires_grad_()

    def own(clip, attributes):
        return renderer.interpolate(renderer.rasterize(clip, faces, 8, 9), faces, attributes)

    def shared(clip, attributes):
        return renderer.interpolate_at(renderer.rasterize(clip, faces, 8, 9), faces, attributes, pixels)

    attributes = torch.rand(2, 48, 2, dtype=torch.float64, requires_grad=True)
    pixels = renderer.rasterize(clip, faces, 8, 9).covered.reshape(-1).nonzero()[::2, 0].repeat(2)  # each twice
    assert len(pixels) > 20
    one = attributes[:1].detach().requires_grad_()
    for _ in range(3):  # directions drawn at random
        assert torch.autograd.gradcheck(own, (clip, attributes), eps=1e-7, atol=1e-5, fast_mode=True)
        assert torch.autograd.gradcheck(shared, (clip, one), eps=1e-7, atol=1e-5, fast_mode=True)


def test_invisible_triangles_are_skipped(renderer):
    corner = torch.tensor([[-0.5, -0.5, 0, 1], [0.5, -0.5, 0, 1], [0, 0.5, 0, 1.0]])
    cases = [corner.clone() for _ in range(8)]
    cases[0][0, 0] = torch.nan
    cases[1][1, 2] = torch.inf
    cases[2] *= -1  # behind the camera
    cases[3][2, 3] = 0
    cases[4][:, 0] += 5  # off screen
    cases[5][2] = cases[5][0]  # degenerate
    cases[6][:, 0] = 1 / 16  # edge-on, through pixel centres
    cases[7][0, :2] = 1e30
    cases[7][1, :2] = -1e30
    clip = torch.stack(cases).requires_grad_()
    faces = torch.tensor([[0, 1, 2]])
    fragments = renderer.rasterize(clip, faces, 16, 16)
    assert not fragments.covered[:7].any()
    silhouette = renderer.silhouette(clip, faces, 16, 16, build_topology(faces))
    assert not silhouette[:7].any()
    image = renderer.antialias(
        renderer.interpolate(fragments, faces, clip[..., :2]), fragments, clip, faces, build_topology(faces)
    )
    (silhouette.sum() + image[:7].sum()).backward()
    assert clip.grad[:7].isfinite().all()


def test_nearly_edge_on_faces_have_finite_gradients(renderer):
    clip = torch.tensor([[[-0.5, -1e-4, 0, 1], [0.5, -1e-4, 0.5, 2], [0, 1e-4, 0, 1.0]]]).requires_grad_()
    faces = torch.tensor([[0, 1, 2]])
    fragments = renderer.rasterize(clip, faces, 9, 9)
    assert fragments.covered.any()
    renderer.interpolate(fragments, faces, torch.rand(1, 3, 2)).square().sum().backward()
    assert clip.grad.isfinite().all()


def test_no_faces(renderer):
    clip = torch.rand(2, 3, 4).requires_grad_()
    faces = torch.zeros(0, 3, dtype=torch.long)
    fragments = renderer.rasterize(clip, faces, 4, 5)
    image = renderer.interpolate(fragments, faces, clip[..., :3])
    image = renderer.antialias(image, fragments, clip, faces, build_topology(faces))
    at = renderer.interpolate_at(fragments, faces, clip[..., :3], torch.tensor([0, 39]))
    silhouette = renderer.silhouette(clip, faces, 4, 5, build_topology(faces))
    assert image.shape == (2, 3, 4, 5)
    assert silhouette.shape == (2, 4, 5)
    assert not image.any()
    assert not at.any()
    assert not silhouette.any()
    (image.sum() + silhouette.sum() + at.sum()).backward()
    assert not clip.grad.any()


def test_no_rows(renderer, soup):
    clip, faces = soup(1, 4)
    clip = clip[:0].requires_grad_()
    fragments = renderer.rasterize(clip, faces, 4, 5)
    image = renderer.interpolate(fragments, faces, torch.rand(1, 12, 2, dtype=torch.float64))
    image = renderer.antialias(image, fragments, clip, faces, build_topology(faces))
    silhouette = renderer.silhouette(clip, faces, 4, 5, build_topology(faces))
    assert image.shape == (0, 2, 4, 5)
    assert silhouette.shape == (0, 4, 5)


def test_order_of_listed_pixels_does_not_matter(renderer, soup):
    """Forward and gradients, for a list that jumps between images and repeats pixels."""
    clip, faces = soup(3, 30)
    order = torch.randperm(3 * 64, generator=torch.Generator().manual_seed(0))
    weights = torch.rand(len(order), 2, dtype=torch.float64)
    results = []
    for pixels, factors in ((torch.arange(3 * 64), weights), (order, weights[order])):
        leaf, attributes = clip.clone().requires_grad_(), torch.linspace(0, 1, 540, dtype=torch.float64).view(3, 90, 2)
        attributes.requires_grad_()
        fragments = renderer.rasterize(leaf, faces, 8, 8)
        values = renderer.interpolate_at(fragments, faces, attributes, pixels)
        results.append(torch.autograd.grad((values * factors).sum(), (leaf, attributes)))
    for one, other in zip(*results, strict=True):
        torch.testing.assert_close(one, other, atol=1e-10, rtol=1e-9)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_backends_agree(soup, blob, project, dtype):
    verts, faces = blob(12)
    for clip, triangles in (soup(3, 60), (project(verts, 3), faces)):
        clip = clip.to(dtype)
        left, right = (R().rasterize(clip, triangles, 40, 31) for R in (TorchRenderer, NumbaRenderer))
        assert torch.equal(left.face_index, right.face_index)
        assert torch.equal(left.depth, right.depth)
        torch.testing.assert_close(left.barycentrics, right.barycentrics, atol=1e-6, rtol=1e-6)


def test_memory_chunks_do_not_change_the_result(soup, monkeypatch):
    clip, faces = soup(2, 40)
    whole = torch_backend.nearest_faces(clip, faces, HEIGHT, WIDTH)
    monkeypatch.setattr(torch_backend, "CHUNK", 50)
    parts = torch_backend.nearest_faces(clip, faces, HEIGHT, WIDTH)
    assert torch.equal(whole[0], parts[0])
    assert torch.equal(whole[1], parts[1])


def test_bands_do_not_change_the_result(soup):
    """A single image is cut into bands of rows, one per thread; several images are not."""
    clip, faces = soup(3, 40)
    renderer = NumbaRenderer()
    together = renderer.rasterize(clip, faces, HEIGHT, WIDTH).face_index
    alone = [renderer.rasterize(row[None], faces, HEIGHT, WIDTH).face_index for row in clip]
    assert torch.equal(together, torch.cat(alone))


def test_without_numba_torch_draws(soup, monkeypatch):
    monkeypatch.setitem(sys.modules, "fauna.renderer.compiled", None)  # importing it fails
    clip, faces = soup(1, 10)
    with pytest.warns(UserWarning, match="numba is not installed"):
        renderer = NumbaRenderer()
    expected = TorchRenderer().rasterize(clip, faces, 8, 8)
    assert torch.equal(renderer.rasterize(clip, faces, 8, 8).face_index, expected.face_index)


def test_messages(renderer, soup, monkeypatch):
    clip, faces = soup(2, 3)
    with pytest.raises(FaunaError, match=r"index 9 vertices, got indices 0\.\.9"):
        renderer.rasterize(clip, faces + torch.tensor([[0, 0, 0], [0, 0, 0], [0, 0, 1]]), 8, 8)
    with pytest.raises(FaunaError, match="float32 or float64, got torch.bfloat16"):
        renderer.rasterize(clip.bfloat16(), faces, 8, 8)
    with pytest.raises(FaunaError, match="must be positive, got 0 x 8"):
        renderer.rasterize(clip, faces, 0, 8)
    fragments = renderer.rasterize(clip, faces, 8, 8)
    with pytest.raises(FaunaError, match="1 or 2 rows, got 3"):
        renderer.interpolate(fragments, faces, torch.rand(3, 9, 2))
    with pytest.raises(FaunaError, match="cover vertex 8, got 8 vertices"):
        renderer.interpolate(fragments, faces, torch.rand(2, 8, 2))
    with pytest.raises(FaunaError, match=r"pixels must lie in 0\.\.127, got 3\.\.128"):
        NumbaRenderer().interpolate_at(fragments, faces, torch.rand(2, 9, 2), torch.tensor([3, 128]))
    topology = build_topology(torch.tensor([[0, 1, 9]]))
    with pytest.raises(FaunaError, match="9 vertices, got index 9; rebuild it"):
        renderer.silhouette(clip, faces, 8, 8, topology)
    monkeypatch.setattr(nvdiffrast_backend.torch.cuda, "is_available", lambda: False)
    with pytest.raises(FaunaError, match="needs a CUDA device"):
        NvdiffrastRenderer()
