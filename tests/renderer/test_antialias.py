import math

import numba
import pytest
import torch

from fauna.geometry.mesh import build_topology
from fauna.renderer import edges
from fauna.renderer.numba_backend import NumbaRenderer
from fauna.renderer.torch_backend import TorchRenderer


def full_step(renderer, clip, faces, size=40):
    """Antialiased image with coverage as last channel, silhouette, and gradients of a weighted sum of both."""
    clip = clip.detach().requires_grad_()
    attributes = torch.linspace(-1, 1, clip.shape[1] * 3, dtype=clip.dtype).cos().view(1, -1, 3).requires_grad_()
    topology = build_topology(faces)
    fragments = renderer.rasterize(clip, faces, size, size)
    image = renderer.interpolate(fragments, faces, attributes)
    image = torch.cat((image, fragments.covered[:, None].to(image)), dim=1)
    image = renderer.antialias(image, fragments, clip, faces, topology)
    silhouette = renderer.silhouette(clip, faces, size, size, topology)
    generator = torch.Generator().manual_seed(1)
    weights = torch.randn(image.shape, generator=generator, dtype=clip.dtype)
    ((image * weights).sum() + (silhouette * weights[:, 0]).sum()).backward()
    return image.detach(), silhouette.detach(), clip.grad, attributes.grad


def relative(found, expected):
    return ((found - expected).norm() / expected.norm()).item()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_backends_agree(blob, project, soup, dtype):
    verts, faces = blob(12)
    for clip, triangles in ((project(verts, 3), faces), soup(2, 40)):
        results = [full_step(R(), clip.to(dtype), triangles) for R in (TorchRenderer, NumbaRenderer)]
        for expected, found in zip(results[0][:2], results[1][:2], strict=True):
            torch.testing.assert_close(found, expected, atol=1e-5, rtol=0)
        for expected, found in zip(results[0][2:], results[1][2:], strict=True):
            assert relative(found, expected) < 1e-4


def test_bitwise_deterministic_for_any_number_of_threads(renderer, blob, project):
    verts, faces = blob(16)
    clip = project(verts, 3).float()
    threads = numba.get_num_threads()
    first = full_step(renderer, clip, faces)
    torch.use_deterministic_algorithms(True)
    try:
        numba.set_num_threads(1)
        second = full_step(renderer, clip, faces)
    finally:
        numba.set_num_threads(threads)
        torch.use_deterministic_algorithms(False)
    for one, other in zip(first, second, strict=True):
        assert torch.equal(one, other)


def test_mask_only_path_equals_full_path(renderer, blob, project):
    verts, faces = blob(10)
    image, silhouette, *_ = full_step(renderer, project(verts, 3), faces)
    torch.testing.assert_close(silhouette, image[:, -1].clamp(0, 1), atol=0, rtol=0)
    assert silhouette.min() == 0
    assert silhouette.max() == 1
    assert 0.02 < ((silhouette > 0) & (silhouette < 1)).double().mean() < 0.5


def test_axis_aligned_square_has_exact_coverage(renderer):
    """Edges between pixel centres: the boundary pixels get just the fraction that is covered."""
    left, right = 2.3, 6.9  # pixel units, pixel k spans [k - 0.5, k + 0.5]
    x = torch.tensor([left, right, right, left], dtype=torch.float64)
    y = torch.tensor([left, left, right, right], dtype=torch.float64)
    ndc = (torch.stack((x, y), dim=1) + 0.5) / 5 - 1
    clip = torch.cat((ndc, torch.zeros(4, 1), torch.ones(4, 1)), dim=1).double()[None]
    faces = torch.tensor([[0, 1, 2], [2, 3, 0]])
    mask = renderer.silhouette(clip, faces, 10, 10, build_topology(faces))[0]
    expected = torch.tensor([0, 0, 0.2, 1, 1, 1, 1, 0.4, 0, 0], dtype=torch.float64)
    torch.testing.assert_close(mask[4], expected, atol=1e-4, rtol=0)
    torch.testing.assert_close(mask[:, 4], expected, atol=1e-4, rtol=0)


def test_occluding_contour_is_blended(renderer):
    """A near square before a larger far one: the step between their colours moves with the near square."""
    near = torch.tensor([[-0.43, -0.5], [0.43, -0.5], [0.43, 0.5], [-0.43, 0.5]], dtype=torch.float64)
    verts = torch.cat((near, 2 * near))
    z = torch.tensor([0.1] * 4 + [0.6] * 4, dtype=torch.float64)
    shift = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    xy = torch.cat((verts[:4] + shift, verts[4:]))
    clip = torch.cat((xy, z[:, None], torch.ones(8, 1)), dim=1)[None]
    faces = torch.tensor([[0, 1, 2], [2, 3, 0], [4, 5, 6], [6, 7, 4]])
    fragments = renderer.rasterize(clip, faces, 16, 16)
    colour = (fragments.face_index < 2).double()[:, None] * fragments.covered[:, None]
    image = renderer.antialias(colour, fragments, clip, faces, build_topology(faces))
    columns = torch.arange(16, dtype=torch.float64)
    (gradient,) = torch.autograd.grad((image[0, 0] * columns).sum(), shift)
    assert image[0, 0, 8, 4].item() == pytest.approx(0.44, abs=1e-3)  # the contour is at 4.06, the pixel ends at 4.5
    area = (0.86 * 8) * 8
    assert gradient[0].item() == pytest.approx(area * 8, rel=0.03)  # moving by 1 NDC = 8 px moves the centroid as much
    assert gradient[1].item() == pytest.approx(0, abs=0.03 * area * 8)


def test_gradients_match_differences_of_the_own_image(renderer, blob, project):
    """Float64: under translation and scaling, which keep slopes, the image is a smooth function between crossings."""
    verts, faces = blob(5)
    clip = project(verts, 1)
    topology = build_topology(faces)

    def silhouette(step):
        return renderer.silhouette(move(clip, step, 10), faces, 10, 10, topology)

    def image(step, attributes):
        moved = move(clip, step, 10)
        fragments = renderer.rasterize(moved, faces, 10, 10)
        return renderer.antialias(renderer.interpolate(fragments, faces, attributes), fragments, moved, faces, topology)

    step = torch.tensor([0.01, -0.02, 0.03], dtype=torch.float64, requires_grad=True)
    attributes = torch.rand(1, len(verts), 1, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(silhouette, (step,), eps=1e-7, atol=1e-5)
    assert torch.autograd.gradcheck(image, (step, attributes), eps=1e-7, atol=1e-5, fast_mode=True)


def test_distances_and_coverage_are_differentiable(blob, project):
    """The two factors of an edge's gradient, for every vertex and component; the kernels agree with torch elsewhere."""
    verts, faces = blob(4)
    clip, topology = project(verts, 2).requires_grad_(), build_topology(faces)
    covered = TorchRenderer().rasterize(clip, faces, 8, 9).covered
    crossings = edges.find_crossings(clip, faces, topology, covered, None)
    assert len(crossings.cell) > 20

    def distances(clip):
        return edges.distances(crossings, clip, topology, 8, 9)

    assert torch.autograd.gradcheck(distances, (clip,), eps=1e-7, atol=1e-5)
    assert distances(clip).min() >= 0
    assert distances(clip).max() <= 1
    slope = torch.linspace(0, 1, 12, dtype=torch.float64)
    for distance in torch.linspace(0.013, 0.967, 7, dtype=torch.float64):
        far = torch.full_like(slope, distance).requires_grad_()
        assert torch.autograd.gradcheck(lambda t: edges.beyond(t, slope), (far,))


def test_part_beyond_a_line_is_its_area():
    """Against a fine grid of points; and the shares of the two pixels change by 1 together."""
    points = (torch.arange(400, dtype=torch.float64) + 0.5) / 400 - 0.5
    distance = torch.linspace(0, 1, 21, dtype=torch.float64).requires_grad_()
    for slope in (0.0, 0.1, 0.5, 1.0):
        slopes = torch.full_like(distance, slope)
        beyond = edges.beyond(distance, slopes)
        line = distance.detach()[:, None, None] + slope * points[:, None]
        area = (points[None, None] > line).double().mean(dim=(1, 2))
        torch.testing.assert_close(beyond, area, atol=3e-3, rtol=0)
        (rate,) = torch.autograd.grad((beyond + edges.beyond(1 - distance.flip(0), slopes)).sum(), distance)
        (one,) = torch.autograd.grad(edges.beyond(distance, slopes).sum(), distance)
        (other,) = torch.autograd.grad(edges.beyond(1 - distance, slopes).sum(), distance)
        assert rate.isfinite().all()
        inside = (distance.detach() != 0.5) | (slope > 0)  # two vertical edges of the same kink
        torch.testing.assert_close((one - other)[inside], torch.full_like(one, -1)[inside])


def test_straight_edges_of_any_direction_have_exact_coverage(renderer):
    """A half plane under 25 angles: antialiased pixels against supersampling."""
    for angle in torch.linspace(0.05, 3.1, 25).tolist():
        normal = torch.tensor([math.cos(angle), math.sin(angle)], dtype=torch.float64)
        along = torch.stack((-normal[1], normal[0]))
        corners = torch.stack((-4 * along, 4 * along, 4 * along - 6 * normal, -4 * along - 6 * normal)) + 0.07 * normal
        clip = torch.cat((corners, torch.zeros(4, 1), torch.ones(4, 1)), dim=1).double()[None]
        faces = torch.tensor([[0, 1, 2], [2, 3, 0]])
        mask = renderer.silhouette(clip, faces, 12, 12, build_topology(faces))
        hard = renderer.rasterize(clip, faces, 12 * 16, 12 * 16).covered[:, None].double()
        exact = torch.nn.functional.avg_pool2d(hard, 16).squeeze(1)
        assert (mask - exact)[:, 2:-2, 2:-2].abs().max() < 0.07
        assert (mask - exact)[:, 2:-2, 2:-2].abs().mean() < 0.006


def supersampled_difference(clip, faces, size, parameter):
    """Central difference over one pixel of coverage, supersampled 8 x 8."""

    def coverage(step):
        hard = NumbaRenderer().rasterize(moved(clip, step), faces, 8 * size, 8 * size).covered
        return torch.nn.functional.avg_pool2d(hard[:, None].double(), 8).squeeze(1)

    def moved(clip, step):
        return move(clip, torch.nn.functional.one_hot(torch.tensor(parameter), 3).double() * step, size)

    return coverage(0.5) - coverage(-0.5)


def move(clip, step, size):
    """Shift by step[:2] pixels and scale so that points at a quarter of the image move by step[2]."""
    xy = clip[..., :2] * (1 + 4 * step[2] / size) + clip[..., 3:] * step[:2] * 2 / size
    return torch.cat((xy, clip[..., 2:]), dim=-1)


@pytest.mark.parametrize(("roughness", "tolerance"), [(0.0, 0.03), (0.01, 0.08)])
def test_silhouette_gradient_is_that_of_exact_coverage(renderer, blob, project, roughness, tolerance):
    """Translation and scale, with triangles of about a pixel: no bias, small relative L2 error, crumpled or not."""
    size = 128
    verts, faces = blob(64)
    assert len(faces) > 16000
    verts = verts + roughness * torch.randn(verts.shape, generator=torch.Generator().manual_seed(2)).double()
    clip = project(verts, 3)
    i, j = torch.meshgrid(torch.arange(size), torch.arange(size), indexing="ij")
    weights = torch.stack(((i / 17.0).sin() + (j / 23.0).cos(), ((i + 2 * j) / 41.0).sin(), (i - j) / 64.0)).double()
    truth = torch.stack([supersampled_difference(clip, faces, size, k) for k in range(3)])
    truth = torch.einsum("krij,wij->rwk", truth, weights)
    topology, found = build_topology(faces), []
    for row in clip:
        step = torch.zeros(3, dtype=torch.float64, requires_grad=True)
        mask = renderer.silhouette(move(row[None], step, size), faces, size, size, topology)[0]
        sums = (weights * mask).sum(dim=(1, 2))
        found.append(torch.stack([torch.autograd.grad(total, step, retain_graph=True)[0] for total in sums]))
    found = torch.stack(found)
    assert relative(found, truth) < tolerance
    assert (found * truth).sum() / truth.square().sum() == pytest.approx(1, abs=tolerance)
