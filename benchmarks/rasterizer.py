"""Time and accuracy of the rasterisers.

One measurement is what a training step asks of them for six images of a closed animal-like surface: find its edges,
rasterise, interpolate nine attributes (six per image, three shared), stack the coverage, antialias the ten channels,
and carry a given gradient of the image back to the positions and the attributes. ``silhouette_ms`` is the mask-only
path of the compiled backend, forward and backward. Backends take turns in one process; medians, in milliseconds.

``gradient_error`` is the relative L2 error of the gradient of smoothly weighted coverage to translation and scale
against central differences of 8 x 8 supersampled coverage; ``image_error`` the mean absolute error of the coverage of
pixels on the outline against the same supersampling. Both are of the compiled backend in float64.

    python benchmarks/rasterizer.py --json rasterizer.json
    python benchmarks/rasterizer.py --smoke
"""

import argparse
import json
import math
import statistics
import time
from collections.abc import Callable

import torch
from arguments import new_file
from torch import Tensor

from fauna.geometry.mesh import build_topology
from fauna.renderer.base import Renderer
from fauna.renderer.numba_backend import NumbaRenderer
from fauna.renderer.torch_backend import TorchRenderer
from fauna.threads import set_threads

SMOKE = ((64, 12),)
DEFAULT = tuple((resolution, cells) for resolution in (128, 256) for cells in (20, 41, 71))
IMAGES = 6
BUMPS = (  # direction, height, sharpness: head, four legs, tail
    ((0.0, 0.6, 1.0), 0.9, 14.0),
    ((0.5, -1.0, 0.7), 0.9, 22.0),
    ((-0.5, -1.0, 0.7), 0.9, 22.0),
    ((0.5, -1.0, -0.7), 0.9, 22.0),
    ((-0.5, -1.0, -0.7), 0.9, 22.0),
    ((0.0, 0.3, -1.0), 0.5, 30.0),
)


def animal_surface(cells: int) -> tuple[Tensor, Tensor]:
    """Closed surface of 12 cells^2 triangles, float64: a sphere cut like a cube, pulled out at head, legs and tail."""
    u, v = torch.meshgrid(torch.arange(cells + 1), torch.arange(cells + 1), indexing="ij")
    corners, quads = [], []
    for axis in range(3):
        for side in (0, cells):
            grid = torch.empty(cells + 1, cells + 1, 3, dtype=torch.long)
            grid[..., axis], grid[..., (axis + 1) % 3], grid[..., (axis + 2) % 3] = side, u, v
            index = (
                torch.arange(grid[..., 0].numel()).reshape(cells + 1, cells + 1) + len(corners) * grid[..., 0].numel()
            )
            quad = torch.stack((index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]), dim=-1).reshape(-1, 4)
            corners.append(grid.reshape(-1, 3))
            quads.append(quad if side else quad.flip(1))
    points, weld = torch.unique(torch.cat(corners), dim=0, return_inverse=True)
    quads = weld[torch.cat(quads)]
    faces = torch.cat((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))
    direction = torch.nn.functional.normalize(torch.tan((2.0 * points.double() / cells - 1.0) * (math.pi / 4)), dim=1)
    radius = torch.full((len(points),), 0.8, dtype=torch.float64)
    for towards, height, sharpness in BUMPS:
        cosine = direction @ torch.nn.functional.normalize(direction.new_tensor(towards), dim=0)
        radius = radius + height * (sharpness * (cosine - 1.0)).exp()
    return direction * radius[:, None] * direction.new_tensor((0.8, 0.9, 1.3)), faces


def project(verts: Tensor, images: int = IMAGES) -> Tensor:
    """Clip positions (image, vert, 4) from cameras all around, see ``docs/conventions.md``."""
    near, far, focal = 0.1, 1000.0, 1.0 / math.tan(math.radians(12.5))
    azimuth = torch.arange(images, dtype=verts.dtype) * (2 * math.pi / images) + 0.3
    cos, sin, zero = azimuth.cos(), azimuth.sin(), torch.zeros_like(azimuth)
    rotation = torch.stack((cos, zero, sin, zero, zero + 1, zero, -sin, zero, cos), dim=1).reshape(-1, 3, 3)
    x, y, z = (torch.einsum("rij,vj->rvi", rotation, verts) - verts.new_tensor((0, 0, 10))).unbind(-1)
    depth = -(far + near) / (far - near) * z - 2 * far * near / (far - near)
    return torch.stack((focal * x, -focal * y, depth, -z), dim=-1)


def training_step(renderer: Renderer, clip: Tensor, faces: Tensor, verts: Tensor, upstream: Tensor) -> Tensor:
    """One step as described at the top of this file; returns the gradient of the positions."""
    clip, shared = clip.detach().requires_grad_(), verts[None].detach().requires_grad_()
    own = torch.cat((clip[..., :3].detach(), clip[..., 1:].detach()), dim=-1).requires_grad_()
    topology = build_topology(faces)
    fragments = renderer.rasterize(clip, faces, *upstream.shape[2:])
    attributes = torch.cat((own, shared.expand(len(own), -1, -1)), dim=-1)
    image = renderer.interpolate(fragments, faces, attributes)
    image = torch.cat((image, fragments.covered[:, None].to(image)), dim=1)
    image = renderer.antialias(image, fragments, clip, faces, topology)
    return torch.autograd.grad(image, (clip, own, shared), upstream)[0]


def silhouette_step(renderer: Renderer, clip: Tensor, faces: Tensor, upstream: Tensor) -> Tensor:
    """Coverage only, and the gradient of the positions."""
    clip = clip.detach().requires_grad_()
    mask = renderer.silhouette(clip, faces, *upstream.shape[2:], build_topology(faces))
    return torch.autograd.grad(mask, clip, upstream[:, 0])[0]


def smooth_weights(count: int, resolution: int) -> Tensor:
    """Fixed smooth images (count, resolution, resolution): sums of waves longer than an eighth of the image."""
    generator = torch.Generator().manual_seed(0)
    axis = torch.arange(resolution, dtype=torch.float64) / resolution
    waves = torch.rand(count, 6, 3, generator=generator, dtype=torch.float64)
    frequency = (waves[..., :2] - 0.5) * (2 * math.pi * 8)
    phase = frequency[..., 0, None, None] * axis[:, None] + frequency[..., 1, None, None] * axis
    return (phase + 2 * math.pi * waves[..., 2, None, None]).cos().sum(dim=1)


def moved(clip: Tensor, pixels: Tensor, resolution: int) -> Tensor:
    """Clip positions shifted by ``pixels`` = (right, down, growth at a quarter of the image from the centre)."""
    xy = clip[..., :2] * (1 + pixels[2] * 4 / resolution) + clip[..., 3:] * (pixels[:2] * 2 / resolution)
    return torch.cat((xy, clip[..., 2:]), dim=-1)


def supersampled(clip: Tensor, faces: Tensor, resolution: int, samples: int = 8) -> Tensor:
    """Coverage (image, resolution, resolution) from ``samples`` squared points in each pixel."""
    size = resolution * samples
    hard = NumbaRenderer().rasterize(clip, faces, size, size).covered.to(clip)
    return torch.nn.functional.avg_pool2d(hard[:, None], samples).squeeze(1)


def gradient_error(renderer: Renderer, clip: Tensor, faces: Tensor, resolution: int) -> float:
    """Relative L2 error of the silhouette's gradients to (right, down, growth) of smoothly weighted coverage."""
    topology, weights = build_topology(faces), smooth_weights(4, resolution)
    ends = [
        supersampled(moved(clip, sign * 0.5 * axis, resolution), faces, resolution)
        for axis in torch.eye(3, dtype=clip.dtype)
        for sign in (1, -1)
    ]
    truth = torch.stack([after - before for after, before in zip(ends[::2], ends[1::2], strict=True)])
    truth = torch.einsum("prij,wij->rwp", truth, weights)
    step = torch.zeros(3, dtype=clip.dtype, requires_grad=True)
    found = []
    for row in clip:
        mask = renderer.silhouette(moved(row[None], step, resolution), faces, resolution, resolution, topology)[0]
        sums = (weights * mask).sum(dim=(1, 2))
        found.append(torch.stack([torch.autograd.grad(total, step, retain_graph=True)[0] for total in sums]))
    return float((torch.stack(found) - truth).norm() / truth.norm())


def image_error(renderer: Renderer, clip: Tensor, faces: Tensor, resolution: int) -> float:
    """Mean absolute error of coverage over the pixels that are covered in part."""
    exact = supersampled(clip, faces, resolution)
    mask = renderer.silhouette(clip, faces, resolution, resolution, build_topology(faces))
    return float((mask - exact).abs()[(exact > 0) & (exact < 1)].mean())


def medians(variants: dict[str, Callable[[], object]], runs: int) -> dict[str, float]:
    """Median time of each, taking turns; the first two turns, which compile and warm up, do not count."""
    times: dict[str, list[float]] = {name: [] for name in variants}
    for run in range(runs + 2):
        for name, variant in variants.items():
            start = time.perf_counter()
            variant()
            if run >= 2:
                times[name].append(1e3 * (time.perf_counter() - start))
    return {name: round(statistics.median(values), 2) for name, values in times.items()}


def measure(resolution: int, cells: int, runs: int) -> dict[str, float | int]:
    """One row of the table."""
    verts, faces = animal_surface(cells)
    exact_clip, verts = project(verts), verts.float()
    clip, slow, fast = exact_clip.float(), TorchRenderer(), NumbaRenderer()
    upstream = torch.randn(len(clip), 10, resolution, resolution, generator=torch.Generator().manual_seed(1))
    times = medians(
        {
            "torch_ms": lambda: training_step(slow, clip, faces, verts, upstream),
            "numba_ms": lambda: training_step(fast, clip, faces, verts, upstream),
            "silhouette_ms": lambda: silhouette_step(fast, clip, faces, upstream),
        },
        runs,
    )
    return {
        "resolution": resolution,
        "triangles": len(faces),
        "torch_ms": times["torch_ms"],
        "numba_ms": times["numba_ms"],
        "ratio": round(times["torch_ms"] / times["numba_ms"], 2),
        "gradient_error": round(gradient_error(fast, exact_clip, faces, resolution), 4),
        "silhouette_ms": times["silhouette_ms"],
        "image_error": round(image_error(fast, exact_clip, faces, resolution), 4),
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=new_file, help="also write the rows to this file")
    parser.add_argument("--smoke", action="store_true", help="one small case, to see that it runs")
    parser.add_argument("--full", action="store_true", help="31 runs of each case instead of 11")
    parser.add_argument("--threads", type=int, default=2, help="CPU threads of torch and the kernels")
    options = parser.parse_args()
    set_threads(options.threads)
    cases, runs = (SMOKE, 2) if options.smoke else (DEFAULT, 31 if options.full else 11)
    rows = []
    for resolution, cells in cases:
        rows.append(measure(resolution, cells, runs))
        print(json.dumps(rows[-1]))
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
