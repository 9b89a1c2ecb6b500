"""Small scenes: closed surfaces, triangle soups and cameras."""

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from fauna.renderer.base import Renderer
from fauna.renderer.numba_backend import NumbaRenderer
from fauna.renderer.torch_backend import TorchRenderer

Mesh = tuple[Tensor, Tensor]


@pytest.fixture(params=[TorchRenderer, NumbaRenderer], ids=["torch", "numba"])
def renderer(request: pytest.FixtureRequest) -> Renderer:
    """Both backends in turn."""
    return request.param()


@pytest.fixture
def blob() -> Callable[[int], Mesh]:
    """Closed bumpy sphere with poles: rings -> (verts float64, faces counter-clockwise from outside)."""

    def build(rings: int) -> Mesh:
        around = 2 * rings
        polar = torch.arange(1, rings, dtype=torch.float64)[:, None] * (math.pi / rings)
        azimuth = torch.arange(around, dtype=torch.float64)[None] * (2 * math.pi / around)
        ring = torch.stack(
            (polar.sin() * azimuth.cos(), polar.cos().expand(-1, around), -polar.sin() * azimuth.sin()), dim=-1
        )
        poles = torch.tensor([[0, 1, 0], [0, -1, 0]], dtype=torch.float64)
        verts = torch.cat((ring.reshape(-1, 3), poles))
        verts = verts * (1.2 + 0.25 * torch.sin(4 * verts[:, :1]) + 0.2 * torch.cos(3 * verts[:, 1:2] + verts[:, 2:]))
        k = torch.arange(around)
        following = (k + 1) % around
        strips = []
        for low in range(0, (rings - 2) * around, around):
            a, b, c, d = low + k, low + following, low + around + k, low + around + following
            strips += [torch.stack((a, c, d), dim=1), torch.stack((a, d, b), dim=1)]
        last, north, south = (rings - 2) * around, len(verts) - 2, len(verts) - 1
        caps = [
            torch.stack((torch.full_like(k, north), k, following), dim=1),
            torch.stack((torch.full_like(k, south), last + following, last + k), dim=1),
        ]
        return verts, torch.cat(strips + caps)

    return build


@pytest.fixture
def project() -> Callable[[Tensor, int], Tensor]:
    """Clip positions (row, vert, 4) of world positions (vert, 3) from cameras spread around the object."""

    def view(verts: Tensor, rows: int) -> Tensor:
        focal = 1 / math.tan(math.radians(12.5))
        clips = []
        for row in range(rows):
            cos, sin = math.cos(0.3 + row), math.sin(0.3 + row)
            x, y, z = verts.unbind(1)
            x, z = cos * x + sin * z, cos * z - sin * x - 10
            clips.append(torch.stack((focal * x, -focal * y, -1.0002 * z - 0.20002, -z), dim=1))
        return torch.stack(clips)

    return view


@pytest.fixture
def soup() -> Callable[[int, int], tuple[Tensor, Tensor]]:
    """Random perspective triangles of all sizes: (rows, triangles) -> (clip positions float64, faces)."""

    def build(rows: int, triangles: int) -> tuple[Tensor, Tensor]:
        generator = torch.Generator().manual_seed(triangles)

        def draw(*shape: int) -> Tensor:
            return torch.rand(*shape, generator=generator, dtype=torch.float64) * 2 - 1

        centre, size = draw(rows, triangles, 1, 2), 0.2 + draw(rows, triangles, 1, 1).square()
        ndc = torch.cat((centre + size * draw(rows, triangles, 3, 2), 0.9 * draw(rows, triangles, 3, 1)), dim=-1)
        w = 2 + 1.5 * draw(rows, triangles, 3, 1)
        return (torch.cat((ndc, w / w), dim=-1) * w).reshape(rows, -1, 4), torch.arange(3 * triangles).reshape(-1, 3)

    return build
