import pytest
import torch

from fauna.errors import FaunaError
from fauna.geometry import mesh
from fauna.geometry.mesh import build_topology, face_areas, face_normals, vertex_normals

TETRAHEDRON = torch.tensor([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
CORNERS = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]], dtype=torch.float64)


@pytest.fixture(params=["numba", "torch"])
def path(request, monkeypatch):
    """Both implementations in turn."""
    if request.param == "torch":
        monkeypatch.setattr(mesh, "kernels", None)


def soup(seed):
    generator = torch.Generator().manual_seed(seed)
    faces = torch.randint(12, (40, 3), generator=generator)
    return torch.randn(2, 12, 3, generator=generator, dtype=torch.float64), faces


def slow_topology(faces):
    """Edge -> ascending faces, by dictionary."""
    found = {}
    for index, face in enumerate(faces.tolist()):
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            if a != b:
                found.setdefault((min(a, b), max(a, b)), []).append(index)
    return sorted(found), [(found[edge] + [-1])[:2] for edge in sorted(found)]


def slow_vertex_normals(verts, faces):
    sums = torch.zeros_like(verts)
    for row in range(len(verts)):
        for face in faces.tolist():
            a, b, c = (verts[row, k] for k in face)
            for k in face:
                sums[row, k] += torch.linalg.cross(b - a, c - a)
    return sums / sums.norm(dim=-1, keepdim=True)


@pytest.mark.usefixtures("path")
@pytest.mark.parametrize("seed", range(4))
def test_topology_equals_a_dictionary(seed):
    _, faces = soup(seed)
    topology = build_topology(faces)
    edges, owners = slow_topology(faces)
    assert topology.edges.tolist() == [list(edge) for edge in edges]
    assert topology.edge_faces.tolist() == [list(pair) for pair in owners]


@pytest.mark.usefixtures("path")
def test_topology_of_closed_and_open_meshes():
    closed = build_topology(TETRAHEDRON)
    assert len(closed.edges) == 6
    assert (closed.edge_faces >= 0).all()
    opened = build_topology(TETRAHEDRON[:3])
    assert (opened.edge_faces[:, 1] < 0).sum() == 3
    assert build_topology(TETRAHEDRON[:0]).edges.shape == (0, 2)
    assert build_topology(torch.tensor([[1, 1, 1]])).edge_faces.shape == (0, 2)


@pytest.mark.usefixtures("path")
def test_vertex_normals_equal_a_loop():
    verts, faces = soup(0)
    torch.testing.assert_close(vertex_normals(verts, faces), slow_vertex_normals(verts, faces))


@pytest.mark.usefixtures("path")
def test_normals_of_a_corner_point_outward():
    normals = face_normals(CORNERS, TETRAHEDRON)[0]
    expected = torch.tensor([[0, 0, -1], [0, -1, 0], [1, 1, 1], [-1, 0, 0]], dtype=torch.float64)
    torch.testing.assert_close(normals, expected / expected.norm(dim=1, keepdim=True))
    outward = CORNERS - CORNERS.mean(dim=1, keepdim=True)
    assert ((vertex_normals(CORNERS, TETRAHEDRON) * outward).sum(dim=-1) > 0).all()
    torch.testing.assert_close(face_areas(CORNERS, TETRAHEDRON)[0], CORNERS.new_tensor([0.5, 0.5, 3**0.5 / 2, 0.5]))


@pytest.mark.usefixtures("path")
def test_normals_turn_with_the_mesh():
    verts, faces = soup(1)
    rotation = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64)).Q
    rotation = rotation * torch.linalg.det(rotation)
    torch.testing.assert_close(vertex_normals(verts @ rotation.T, faces), vertex_normals(verts, faces) @ rotation.T)


@pytest.mark.usefixtures("path")
def test_degenerate_meshes_have_the_fallback_normal_and_finite_gradients():
    verts = torch.zeros(1, 4, 3, requires_grad=True)
    faces = torch.tensor([[0, 1, 2]])
    up = torch.tensor([0.0, 0, 1])
    assert torch.equal(vertex_normals(verts, faces), up.expand(1, 4, 3))
    assert torch.equal(face_normals(verts, faces), up.expand(1, 1, 3))
    assert torch.equal(face_areas(verts, faces), torch.zeros(1, 1))
    (vertex_normals(verts, faces).sum() + face_normals(verts, faces).sum() + face_areas(verts, faces).sum()).backward()
    assert torch.equal(verts.grad, torch.zeros_like(verts))
    assert vertex_normals(verts, faces[:0]).shape == (1, 4, 3)


@pytest.mark.usefixtures("path")
def test_gradients():
    verts, faces = soup(2)
    verts, faces = verts.requires_grad_(), faces[(faces != faces.roll(1, dims=1)).all(dim=1)]
    for function in (vertex_normals, face_normals, face_areas):
        assert torch.autograd.gradcheck(lambda points, function=function: function(points, faces), (verts,))


@pytest.mark.usefixtures("path")
def test_bitwise_deterministic():
    verts, faces = soup(3)
    gradients = []
    for deterministic in (False, True):
        torch.use_deterministic_algorithms(deterministic)
        try:
            leaf = verts.float().requires_grad_()
            vertex_normals(leaf, faces).cumsum(dim=1).sum().backward()
        finally:
            torch.use_deterministic_algorithms(False)
        gradients.append(leaf.grad)
    assert torch.equal(*gradients)


@pytest.mark.usefixtures("path")
def test_faces_of_another_mesh_are_rejected():
    with pytest.raises(FaunaError, match="index 3 vertices, got index 3"):
        vertex_normals(CORNERS[:, :3], TETRAHEDRON)


def test_paths_agree(monkeypatch):
    verts, faces = soup(0)
    results = []
    for kernels in (mesh.kernels, None):
        monkeypatch.setattr(mesh, "kernels", kernels)
        leaf = verts.float().requires_grad_()
        normals = vertex_normals(leaf, faces)
        normals.sin().sum().backward()
        results.append((normals.detach(), leaf.grad))
    for one, other in zip(*results, strict=True):
        torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-4)


def test_bounds_are_remembered_until_the_tensor_changes(monkeypatch):
    looked = []
    monkeypatch.setattr(torch, "aminmax", lambda index, look=torch.aminmax: looked.append(1) or look(index))
    faces = TETRAHEDRON.clone()
    assert mesh.index_bounds(faces) == mesh.index_bounds(faces) == (0, 3)
    assert len(looked) == 1
    faces[0, 0] = 7
    assert mesh.index_bounds(faces) == (0, 7)
    assert mesh.index_bounds(faces[:0]) == (0, -1)
    with torch.inference_mode():
        assert mesh.index_bounds(TETRAHEDRON + 1) == (1, 4)
