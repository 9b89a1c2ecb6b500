"""Sparse against dense extraction of the base shape: time of forward plus backward, memory, equality of the meshes.

One row per grid resolution (in the paper's units), timings in milliseconds, medians of interleaved runs in one process;
``memory_ratio`` compares the growth of the peak resident set in fresh processes (Linux only). Not counted for the dense
side: listing the tetrahedra.

    python benchmarks/extraction.py [--smoke | --full] [--width 256] [--json]
"""

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from statistics import median

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from fauna.geometry.lattice import BCCLattice, cell_size_of, explicit_lattice
from fauna.geometry.sparse_extraction import extract_dense, extract_sparse
from fauna.shape.sdf_mlp import SDFNetwork

GRID_SCALE = 7.0
OFFSET = (0.0, 0.013, -0.021)


def make_network(width: int) -> tuple[SDFNetwork, Tensor]:
    """A random network that bends the ellipsoid visibly, and a shape code."""
    torch.manual_seed(0)
    network = SDFNetwork(
        embedding_dim=128,
        num_octaves=8,
        base_frequency=0.9 * 2 * torch.pi / GRID_SCALE,
        hidden_dim=width,
        num_layers=5,
        ellipsoid_radii=(1.05, 1.05, 2.1),
        residual_scale=0.3,
        style_offset=1.0,
        demodulation_eps=1e-5,
    )
    return network, torch.randn(128)


def make_runs(resolution: int, width: int, kinds: tuple[str, ...]) -> dict[str, Callable[[], tuple[Tensor, Tensor]]]:
    """Functions that extract a mesh of the same field and back-propagate through it."""
    network, code = make_network(width)
    half = GRID_SCALE / 2
    lattice = BCCLattice(cell_size=cell_size_of(GRID_SCALE, resolution), half_extents=(half, half, half))
    offset = torch.tensor(OFFSET)
    extractors = {"sparse": partial(extract_sparse, lipschitz=1.5, coarse_cells=8)}
    if "dense" in kinds:
        extractors["dense"] = partial(extract_dense, explicit=explicit_lattice(lattice))

    def run(kind: str) -> tuple[Tensor, Tensor]:
        network.zero_grad()
        verts, faces = extractors[kind](network(code), lattice, offset)[:2]
        verts.square().sum().backward()
        return verts.detach(), faces

    return {kind: partial(run, kind) for kind in kinds}


def identical(first: tuple[Tensor, Tensor], second: tuple[Tensor, Tensor]) -> bool:
    """Whether two meshes have the same vertices to 1e-5 and the same set of oriented faces."""
    if first[0].shape != second[0].shape or first[1].shape != second[1].shape:
        return False
    distance, match = cKDTree(second[0].numpy()).query(first[0].numpy())
    if distance.max() > 1e-5 or len(np.unique(match)) != len(match):
        return False
    return np.array_equal(_sorted_faces(match[first[1].numpy()]), _sorted_faces(second[1].numpy()))


def _sorted_faces(faces: np.ndarray) -> np.ndarray:
    start = faces.argmin(axis=1)[:, None]
    faces = np.take_along_axis(faces, (start + np.arange(3)) % 3, axis=1)
    return faces[np.lexsort(faces.T)]


def peak_growth(resolution: int, width: int, kind: str) -> int:
    """KiB by which one extraction raises the peak resident set of this process above what it holds before."""
    make_runs(16, width, (kind,))[kind]()
    run = make_runs(resolution, width, (kind,))[kind]
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts again from the current size
    before = _status("VmRSS")
    run()
    return _status("VmHWM") - before


def _status(field: str) -> int:
    """A size in KiB from the kernel's account of this process (Linux)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(field + ":"))


def measure(resolution: int, width: int, repeats: int) -> dict[str, float | int | bool]:
    """One row of the table."""
    with get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        tasks = [(resolution, width, kind) for kind in ("dense", "sparse")]
        dense_peak, sparse_peak = pool.starmap(peak_growth, tasks, chunksize=1)
    runs = make_runs(resolution, width, ("dense", "sparse"))
    times, meshes = {"dense": [], "sparse": []}, {}
    runs["sparse"]()
    for _ in range(repeats):
        for kind, run in runs.items():
            start = time.perf_counter()
            meshes[kind] = run()
            times[kind].append(1e3 * (time.perf_counter() - start))
    dense_ms, sparse_ms = median(times["dense"]), median(times["sparse"])
    return {
        "spacing": resolution,
        "width": width,
        "faces": len(meshes["sparse"][1]),
        "dense_ms": round(dense_ms, 1),
        "sparse_ms": round(sparse_ms, 1),
        "ratio": round(dense_ms / sparse_ms, 1),
        "memory_ratio": round(dense_peak / max(sparse_peak, 1), 1),
        "identical": identical(meshes["dense"], meshes["sparse"]),
    }


def main() -> None:
    """Print one row per resolution."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--smoke", action="store_true", help="resolution 32, width 64, one run")
    size.add_argument("--full", action="store_true", help="add resolution 256, which needs 16 GiB")
    parser.add_argument("--width", type=int, default=256, help="width of the network")
    parser.add_argument("--repeats", type=int, default=5, help="interleaved runs per row")
    parser.add_argument("--json", action="store_true", help="one JSON object per line")
    args = parser.parse_args()
    resolutions = [32] if args.smoke else [64, 128, 256] if args.full else [64, 128]
    for resolution in resolutions:
        row = measure(resolution, 64 if args.smoke else args.width, 1 if args.smoke else args.repeats)
        print(json.dumps(row) if args.json else "  ".join(f"{key} {value}" for key, value in row.items()), flush=True)


if __name__ == "__main__":
    main()
