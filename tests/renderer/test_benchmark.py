import importlib.util
import json
from pathlib import Path

import pytest
import torch

from fauna.geometry.mesh import build_topology, face_normals

PATH = Path(__file__).parents[2] / "benchmarks" / "rasterizer.py"


@pytest.fixture(scope="module")
def benchmark():
    """The benchmark script as a module."""
    spec = importlib.util.spec_from_file_location("rasterizer_benchmark", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_surface_is_closed_and_outward(benchmark):
    verts, faces = benchmark.animal_surface(6)
    assert len(faces) == 12 * 6**2
    topology = build_topology(faces)
    assert (topology.edge_faces >= 0).all()
    assert len(verts) - len(topology.edges) + len(faces) == 2
    a, b, c = verts[faces].unbind(1)
    assert (torch.linalg.cross(a, b) * c).sum() / 6 > 1  # volume enclosed, positive if outward
    assert face_normals(verts[None], faces).isfinite().all()


def test_smoke_run_writes_rows(benchmark, monkeypatch, tmp_path):
    monkeypatch.setattr(
        "sys.argv",
        ["rasterizer.py", "--smoke", "--threads", str(torch.get_num_threads()), "--json", str(tmp_path / "rows.json")],
    )
    benchmark.main()
    (row,) = json.loads((tmp_path / "rows.json").read_text())
    fields = ["resolution", "triangles", "torch_ms", "numba_ms", "ratio", "gradient_error"]
    assert list(row) == [*fields, "silhouette_ms", "image_error"]
    assert 0 < row["gradient_error"] < 0.05
    assert 0 < row["image_error"] < 0.03
    assert row["ratio"] > 0
