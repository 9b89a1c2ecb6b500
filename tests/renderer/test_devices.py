"""What GPUs ask of the torch operations: as far as can be seen without one, and against the CPU where one is."""

import importlib.util

import pytest
import torch
from torch.overrides import TorchFunctionMode

from fauna.geometry import mesh
from fauna.geometry.mesh import build_topology, vertex_normals
from fauna.renderer.numba_backend import NumbaRenderer
from fauna.renderer.nvdiffrast_backend import NvdiffrastRenderer
from fauna.renderer.torch_backend import TorchRenderer

FACTORIES = (torch.arange, torch.zeros, torch.ones, torch.full, torch.empty, torch.eye, torch.linspace)
FROM_HOST = (torch.tensor, torch.as_tensor, torch.from_numpy, torch.Tensor.new_tensor, torch.Tensor.cpu)
needs_cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
needs_nvdiffrast = pytest.mark.skipif(importlib.util.find_spec("nvdiffrast") is None, reason="needs nvdiffrast")


class OnTheDevice(TorchFunctionMode):
    """Refuses tensors made without a device, or from values in Python."""

    def __torch_function__(self, function, types, args=(), kwargs=None):
        assert function not in FROM_HOST, function
        assert function not in FACTORIES or (kwargs or {}).get("device") is not None, function
        return function(*args, **(kwargs or {}))


def everything(renderer, clip, faces, attributes):
    """Image, silhouette, and the gradients of a weighted sum of both."""
    clip, attributes = clip.detach().requires_grad_(), attributes.detach().requires_grad_()
    topology = build_topology(faces)
    fragments = renderer.rasterize(clip, faces, 40, 40)
    pixels = fragments.covered.reshape(-1).nonzero().squeeze(1)
    listed = renderer.interpolate_at(fragments, faces, vertex_normals(clip[..., :3], faces), pixels)
    image = renderer.interpolate(fragments, faces, attributes)
    image = renderer.antialias(image, fragments, clip, faces, topology)
    silhouette = renderer.silhouette(clip, faces, 40, 40, topology)
    total = (image * image.detach().cos()).sum() + silhouette.square().sum() + listed.square().mean()
    return fragments.covered, image.detach(), silhouette.detach(), *torch.autograd.grad(total, (clip, attributes))


def scene(blob, project):
    verts, faces = blob(10)
    return project(verts, 3).float(), faces, verts.float()[None]


def test_nothing_is_made_on_the_host(blob, project, monkeypatch):
    monkeypatch.setattr(mesh, "kernels", None)
    arguments = scene(blob, project)
    with OnTheDevice():
        covered, *_ = everything(TorchRenderer(), *arguments)
    assert covered.any()


def test_nothing_lacks_a_deterministic_form(blob, project):
    """Operations without one would raise here on a GPU; on CPU the results must at least repeat bit by bit."""
    results = []
    for deterministic in (False, True):
        torch.use_deterministic_algorithms(deterministic)
        try:
            results.append(everything(TorchRenderer(), *scene(blob, project)))
        finally:
            torch.use_deterministic_algorithms(False)
    assert all(torch.equal(one, other) for one, other in zip(*results, strict=True))


@needs_cuda
@pytest.mark.parametrize(
    "backend", [TorchRenderer, NumbaRenderer, pytest.param(NvdiffrastRenderer, marks=needs_nvdiffrast)]
)
def test_cuda_equals_cpu(backend, blob, project):
    arguments = scene(blob, project)
    expected = everything(TorchRenderer(), *arguments)
    torch.use_deterministic_algorithms(True, warn_only=backend is NvdiffrastRenderer)
    try:
        found = everything(backend(), *(tensor.cuda() for tensor in arguments))
    finally:
        torch.use_deterministic_algorithms(False)
    assert (found[0].cpu() != expected[0]).float().mean() < 1e-3
    for one, other in zip(found[1:], expected[1:], strict=True):
        assert (one.cpu() - other).norm() < 0.02 * other.norm()
