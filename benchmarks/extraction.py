"""Sparse against dense extraction of the base shape: time of forward plus backward, memory, equality.

One row per network and grid resolution (``spacing``, in the paper's units); milliseconds, medians of interleaved runs
in one process. Dense evaluates every lattice point of both halves in fp32 and keeps what back-propagation needs of
each; like sparse it does so in chunks of rows that suit the cache, so what is counted is activations, marks,
tetrahedra and gradients, not temporaries as large as the lattice times the width. Not counted for the dense side:
listing the tetrahedra, in time or memory. ``memory_ratio`` compares the growth of the peak resident set in fresh
processes (Linux).

Networks: random ones, random ones with thin legs or with islands (analytic parts joined by a maximum), and the shapes
of weight files, with the mean of their bank for a code. ``gradient_error`` is the relative L2 difference of all
parameters' gradients.

    python benchmarks/extraction.py [--smoke | --full] [--json FILE] [--weights FILE...]
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch
from arguments import existing_file, new_file
from scipy.spatial import cKDTree
from torch import Tensor, nn

from fauna.geometry.lattice import BCCLattice, cell_size_of, explicit_lattice
from fauna.geometry.marching_tets import face_components
from fauna.geometry.narrow_band import SDF
from fauna.geometry.sparse_extraction import extract_dense, extract_sparse
from fauna.shape.sdf_mlp import SDFField, SDFNetwork

GRID_SCALE = 7.0
OFFSET = (0.0, 0.013, -0.021)
GIB_OF_DENSE_256 = 18
CAPSULES = {
    "random": (),
    "legs": (((0.5, 0.0, 1.2), (0.5, -2.2, 1.3), 0.09), ((0.5, 0.0, -1.2), (0.5, -2.2, -1.3), 0.12)),
    "islands": (((1.6, 1.7, 0.0), (1.6, 1.7, 0.3), 0.35), ((0.0, -2.2, 1.5), (0.0, -2.4, 1.5), 0.3)),
}
"""Start, end and radius of what is joined to the random networks, mirrored at x = 0."""


@dataclass(frozen=True)
class Net:
    """A network to measure; small enough to be sent to another process.

    Attributes:
        kind: key of ``CAPSULES``, or ``file``.
        seed: of a random network.
        width: of its layers.
        path: weight file.
    """

    kind: str
    seed: int = 0
    width: int = 256
    path: Path | None = None

    @property
    def name(self) -> str:
        """As in the rows."""
        return f"{self.kind} {self.seed}" if self.path is None else f"{self.path.parent.name}/{self.path.name}"


@dataclass(frozen=True)
class Subject:
    """A network at hand.

    Attributes:
        network: its parameters.
        code: shape code.
        grid_scale: edge of the paper's cube, world units.
        half_extents: of the box, world units.
        in_bfloat16: whether sparse extraction may use bfloat16.
    """

    network: SDFNetwork
    code: Tensor
    grid_scale: float
    half_extents: tuple[float, float, float]
    in_bfloat16: bool

    def lattice(self, spacing: int) -> BCCLattice:
        """Of a resolution in the paper's units."""
        return BCCLattice(cell_size=cell_size_of(self.grid_scale, spacing), half_extents=self.half_extents)


def load(net: Net) -> Subject:
    """Random networks of the paper's form that bend the ellipsoid visibly, or the one of a weight file."""
    if net.path is not None:
        return _load_file(net.path)
    torch.manual_seed(net.seed)
    network = SDFNetwork(
        embedding_dim=128,
        num_octaves=8,
        base_frequency=0.9 * 2 * torch.pi / GRID_SCALE,
        hidden_dim=net.width,
        num_layers=5,
        ellipsoid_radii=(1.05, 1.05, 2.1),
        ellipsoid_lift=0.0,
        legs=None,
        residual_scale=0.3,
        style_offset=1.0,
        demodulation_eps=1e-5,
    )
    half = GRID_SCALE / 2
    return Subject(network, torch.randn(128), GRID_SCALE, (half, half, half), in_bfloat16=True)


def _load_file(path: Path) -> Subject:
    from hydra.utils import instantiate
    from omegaconf import OmegaConf
    from safetensors import safe_open

    with safe_open(path, framework="pt") as file:
        config = OmegaConf.create(file.metadata()["config"])
        names = [name for name in file.keys() if name.startswith(("shape.", "bank."))]  # noqa: SIM118, not a dictionary
        tensors = {name: file.get_tensor(name).float() for name in names}
    shape = instantiate(config.shape, _convert_="all")
    shape.load_state_dict({name.removeprefix("shape."): t for name, t in tensors.items() if name.startswith("shape.")})
    code = tensors["bank.values"].mean(dim=0)
    return Subject(shape.sdf, code, shape.grid_scale, shape.half_extents, in_bfloat16=shape.coarse_bf16)


def with_capsules(sdf: SDF, kind: str) -> SDF:
    """Union of a signed distance and the capsules of a kind."""

    def union(points: Tensor) -> Tensor:
        folded = torch.cat((points[:, :1].abs(), points[:, 1:]), dim=1)
        parts = [sdf(points)]
        for start, end, radius in CAPSULES[kind]:
            first, second = folded.new_tensor(start), folded.new_tensor(end)
            along = ((folded - first) @ (second - first) / (second - first).square().sum()).clamp(0, 1)
            parts.append(radius - (folded - first - along[:, None] * (second - first)).norm(dim=1))
        return torch.stack(parts).amax(dim=0)

    return union if CAPSULES.get(kind) else sdf


@dataclass(frozen=True)
class Result:
    """What one run returns: vertices, faces and all gradients in a row."""

    verts: Tensor
    faces: Tensor
    gradient: Tensor


def make_runs(net: Net, spacing: int, kinds: tuple[str, ...]) -> dict[str, Callable[[], Result]]:
    """Functions that extract a mesh of the same field and back-propagate through it."""
    subject = load(net)
    lattice, offset, direction = subject.lattice(spacing), torch.tensor(OFFSET), torch.tensor((0.3, -0.2, 0.9))
    explicit = explicit_lattice(lattice) if "dense" in kinds else None

    def extract(kind: str, field: SDFField) -> tuple[Tensor, Tensor]:
        sdf = with_capsules(field, net.kind)
        if kind == "dense":
            return extract_dense(sdf, lattice, offset, explicit)
        cheap = with_capsules(field.coarse, net.kind) if subject.in_bfloat16 else None
        return extract_sparse(sdf, lattice, offset, lipschitz=1.5, coarse_cells=8, approximation=cheap)[:2]

    def run(kind: str) -> Result:
        subject.network.zero_grad()
        verts, faces = extract(kind, subject.network(subject.code))
        torch.sin(3 * verts @ direction).sum().backward()
        return Result(verts.detach(), faces, _gradients(subject.network))

    return {kind: partial(run, kind) for kind in kinds}


def _gradients(network: nn.Module) -> Tensor:
    return torch.cat([p.grad.flatten() for p in network.parameters() if p.grad is not None])


def identical(first: Result, second: Result) -> bool:
    """Whether two meshes have the same vertices to 1e-5 and the same set of oriented faces."""
    if first.verts.shape != second.verts.shape or first.faces.shape != second.faces.shape:
        return False
    distance, match = cKDTree(second.verts.numpy()).query(first.verts.numpy())
    if distance.max() > 1e-5 or len(np.unique(match)) != len(match):
        return False
    return np.array_equal(_sorted_faces(match[first.faces.numpy()]), _sorted_faces(second.faces.numpy()))


def _sorted_faces(faces: np.ndarray) -> np.ndarray:
    start = faces.argmin(axis=1)[:, None]
    faces = np.take_along_axis(faces, (start + np.arange(3)) % 3, axis=1)
    return faces[np.lexsort(faces.T)]


def peak_growth(net: Net, spacing: int, kind: str, threads: int) -> int:
    """KiB by which one extraction raises the peak resident set of this process above what it holds before."""
    torch.set_num_threads(threads)
    make_runs(net, 16, (kind,))[kind]()
    run = make_runs(net, spacing, (kind,))[kind]
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts again from the current size
    before = _kib("/proc/self/status", "VmRSS")
    run()
    return _kib("/proc/self/status", "VmHWM") - before


def _kib(file: str, field: str) -> int:
    """A size from one of the kernel's tables (Linux)."""
    lines = Path(file).read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(field + ":"))


def measure(net: Net, spacing: int, repeats: int) -> dict[str, Any]:
    """One row of the table; dense runs stop after the first that takes a quarter of a minute."""
    with get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        tasks = [(net, spacing, kind, torch.get_num_threads()) for kind in ("dense", "sparse")]
        dense_kib, sparse_kib = pool.starmap(peak_growth, tasks, chunksize=1)
    runs, times, results = make_runs(net, spacing, ("dense", "sparse")), {"dense": [], "sparse": []}, {}
    runs["sparse"]()
    for _ in range(repeats):
        for kind, run in runs.items():
            if kind == "dense" and times[kind] and times[kind][0] > 15e3:
                continue
            start = time.perf_counter()
            results[kind] = run()
            times[kind].append(1e3 * (time.perf_counter() - start))
    dense, sparse = results["dense"], results["sparse"]
    dense_ms, sparse_ms = median(times["dense"]), median(times["sparse"])
    return {
        "spacing": spacing,
        "net": net.name,
        "width": load(net).network.in_layer.out_features,
        "faces": len(sparse.faces),
        "components": int(face_components(sparse.faces, len(sparse.verts)).max()) + 1,
        "dense_ms": round(dense_ms, 1),
        "sparse_ms": round(sparse_ms, 1),
        "ratio": round(dense_ms / sparse_ms, 1),
        "memory_ratio": round(dense_kib / max(sparse_kib, 1), 1),
        "sparse_mib": round(sparse_kib / 1024, 1),
        "identical": identical(dense, sparse),
        "gradient_error": float((sparse.gradient - dense.gradient).norm() / dense.gradient.norm()),
    }


def plan(args: argparse.Namespace) -> list[tuple[Net, int, int]]:
    """Networks, resolutions and numbers of repeats."""
    kinds = list(CAPSULES)
    if args.smoke:
        return [(Net("legs", width=16), 32, 1)]
    random = [Net(kinds[i % 3], i // 3, args.width) for i in range(100)]
    files = [Net("file", path=path) for path in args.weights]
    small, middle, large = (100, 10, 2) if args.full else (6, 3, 1)
    rows = [(net, 64, 3 if args.full else 5) for net in (files + random)[: max(small, len(files) + 3)]]
    rows += [(net, 128, 1 if args.full else 3) for net in (files[:1] + random)[:middle]]
    return rows + [(net, 256, 3) for net in random[:large]]


def main() -> None:
    """Print and write one row per network and resolution."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--smoke", action="store_true", help="one narrow network at resolution 32")
    size.add_argument("--full", action="store_true", help="100 networks at 64, 10 at 128, 2 at 256; default 6, 3 and 1")
    parser.add_argument("--spacing", type=int, nargs="*", help="only these resolutions")
    parser.add_argument("--width", type=int, default=256, help="width of the random networks")
    parser.add_argument("--weights", type=existing_file, nargs="*", default=[], help="weight files to measure too")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    parser.add_argument("--json", type=new_file, metavar="FILE", help="write a list of rows")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    rows: list[dict[str, Any]] = []
    for net, spacing, repeats in plan(args):
        if args.spacing and spacing not in args.spacing:
            continue
        if spacing >= 256 and _kib("/proc/meminfo", "MemAvailable") < GIB_OF_DENSE_256 * 2**20:
            print(f"spacing {spacing} left out: dense needs up to {GIB_OF_DENSE_256} GiB")
            continue
        rows.append(measure(net, spacing, repeats))
        print("  ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
        if args.json:
            args.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
