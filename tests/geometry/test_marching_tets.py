from itertools import combinations

import pytest
import torch

from fauna.geometry.lattice import BCCLattice, explicit_lattice
from fauna.geometry.marching_tets import (
    drop_small_components,
    face_components,
    interpolate_zeros,
    marching_tets,
    tet_triangles,
)

TET = torch.tensor([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)


def slow_marching_tets(verts, sdf, tets):
    """Vertices (as a dict by edge) and signed volume (by fanning polygons), one tetrahedron at a time."""
    places, triangles = {}, 0
    volume = 0.0
    for tet in tets.tolist():
        inner = [v for v in tet if sdf[v] > 0]
        outer = [v for v in tet if sdf[v] <= 0]
        if not inner or not outer:
            continue
        polygon = [(i, o) for i in inner for o in outer]
        if len(polygon) == 4:
            polygon = [polygon[0], polygon[1], polygon[3], polygon[2]]
        points = []
        for i, o in polygon:
            share = sdf[i] / (sdf[i] - sdf[o])
            point = verts[i] + share * (verts[o] - verts[i])
            places[(i, o)] = point
            points.append(point)
        outwards = verts[outer].mean(0) - verts[inner].mean(0)
        for b, c in zip(points[1:-1], points[2:], strict=True):
            normal = torch.linalg.cross(b - points[0], c - points[0])
            sign = 1.0 if normal @ outwards > 0 else -1.0
            volume += sign * float(torch.linalg.det(torch.stack((points[0], b, c)))) / 6
            triangles += 1
    return torch.stack([places[key] for key in sorted(places)]), triangles, volume


def mesh_volume(verts, faces):
    return float(torch.linalg.det(verts[faces]).sum() / 6)


def edge_counts(faces):
    directed = torch.cat([faces[:, [i, (i + 1) % 3]] for i in range(3)])
    unique, counts = torch.unique(directed, dim=0, return_counts=True)
    return unique, counts


@pytest.mark.parametrize("case", range(16))
def test_every_sign_pattern_separates_inside_from_outside(case):
    sdf = torch.tensor([1.0 if case >> i & 1 else -1.0 for i in range(4)], dtype=torch.float64)
    verts, faces = marching_tets(TET, sdf, torch.arange(4)[None])
    assert len(faces) == {0: 0, 1: 1, 2: 2, 3: 1, 4: 0}[int((sdf > 0).sum())]
    for triangle in verts[faces]:
        normal = torch.linalg.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        side = (TET - triangle[0]) @ normal
        assert (side * sdf <= 1e-12).all()
        assert side.abs().max() > 0.1


def test_orientation_of_the_tetrahedron_does_not_matter():
    sdf = torch.tensor([1.0, 0.4, -1.0, -2.0], dtype=torch.float64)
    first = marching_tets(TET, sdf, torch.tensor([[0, 1, 2, 3]]))
    second = marching_tets(TET, sdf, torch.tensor([[1, 0, 2, 3]]))
    torch.testing.assert_close(first[0], second[0])
    apex = torch.tensor([0.0, 0.0, 0.0], dtype=torch.float64)
    for verts, faces in (first, second):
        for triangle in verts[faces]:
            assert torch.linalg.det(triangle - apex) > 0


def test_matches_the_slow_reference():
    lattice = BCCLattice(cell_size=0.5, half_extents=(1.0, 1.0, 1.5))
    explicit = explicit_lattice(lattice)
    verts = explicit.positions(lattice, torch.tensor([0.0, 0.04, 0.1], dtype=torch.float64))
    sdf = 0.8 - (verts * torch.tensor([1.0, 1.1, 0.6])).norm(dim=1) + 0.1 * torch.sin(5 * verts).sum(dim=1)
    sdf = lattice.close(lattice.half_steps(explicit.points), sdf)
    got, faces = marching_tets(verts, sdf, explicit.tets)
    expected, triangles, volume = slow_marching_tets(verts, sdf, explicit.tets)
    torch.testing.assert_close(got, expected, rtol=0, atol=1e-12)
    assert len(faces) == triangles
    assert mesh_volume(got, faces) == pytest.approx(volume, rel=1e-9)
    assert volume > 0
    unique, counts = edge_counts(faces)
    assert (counts == 1).all()
    assert torch.equal(torch.unique(unique.flip(1), dim=0), unique)


def test_interpolation_is_exact_for_linear_functions_and_stays_on_the_edge():
    ends = torch.randn(50, 2, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    sdf = ends @ torch.tensor([1.0, -0.5, 0.2], dtype=torch.float64) - 0.1
    keep = (sdf[:, 0] > 0) != (sdf[:, 1] > 0)
    ends, sdf = ends[keep], sdf[keep]
    outer_first = (sdf[:, 0] <= 0)[:, None]
    sdf = torch.where(outer_first, sdf.flip(1), sdf)
    ends = torch.where(outer_first[..., None], ends.flip(1), ends)
    zeros = interpolate_zeros(ends, sdf)
    assert len(ends) > 10
    torch.testing.assert_close(
        zeros @ torch.tensor([1.0, -0.5, 0.2], dtype=torch.float64), torch.full_like(zeros[:, 0], 0.1)
    )
    wrong = interpolate_zeros(ends[:1], torch.tensor([[-1e-9, -1.0]], dtype=torch.float64))
    torch.testing.assert_close(wrong[0], ends[0, 0])


def test_gradient_of_vertices():
    explicit = explicit_lattice(BCCLattice(cell_size=1.0, half_extents=(1.0, 1.0, 1.0)))
    lattice = BCCLattice(cell_size=1.0, half_extents=(1.0, 1.0, 1.0))
    verts = explicit.positions(lattice, torch.zeros(3, dtype=torch.float64))
    sdf = (0.7 - verts.norm(dim=1)).requires_grad_()
    assert torch.autograd.gradcheck(lambda s: marching_tets(verts, s, explicit.tets)[0], (sdf,))


def test_zero_counts_as_outside_and_empty_is_empty():
    sdf = torch.tensor([0.0, -1.0, 0.0, -1.0], dtype=torch.float64)
    verts, faces = marching_tets(TET, sdf, torch.arange(4)[None])
    assert verts.shape == (0, 3)
    assert faces.shape == (0, 3)


def test_triangles_name_the_tetrahedron_they_lie_in():
    inside = torch.tensor([[1, 0, 0, 0], [1, 1, 0, 0], [0, 0, 0, 0]], dtype=torch.bool)
    faces, tets = tet_triangles(inside, torch.arange(18).view(3, 6))
    assert tets.tolist() == [0, 1, 1]
    assert torch.equal(faces // 6, tets[:, None].expand(-1, 3))


def tetrahedra(count_per_component):
    """Disjoint strips of triangles, one per entry."""
    faces, start = [], 0
    for count in count_per_component:
        faces += [[start + i, start + i + 1, start + i + 2] for i in range(count)]
        start += count + 2
    return torch.randn(start, 3, generator=torch.Generator().manual_seed(0)), torch.tensor(faces)


def test_components_and_dropping_the_small_ones():
    verts, faces = tetrahedra([2, 10, 1])
    component = face_components(faces, len(verts))
    assert torch.bincount(component).tolist() == [2, 10, 1]
    kept_verts, kept_faces = drop_small_components(verts, faces, 0.5)
    assert torch.equal(kept_verts[kept_faces], verts[faces[2:12]])
    assert len(kept_verts) == 12
    assert len(drop_small_components(verts, faces, 0.1)[1]) == 12
    assert drop_small_components(verts, faces, 0.0)[1] is faces


def test_largest_component_always_stays():
    verts, faces = tetrahedra([3, 4, 3])
    assert len(drop_small_components(verts, faces, 0.9)[1]) == 4


def test_components_agree_with_union_find():
    generator = torch.Generator().manual_seed(3)
    faces = torch.randint(60, (25, 3), generator=generator)
    parent = list(range(60))

    def root(v):
        while parent[v] != v:
            v = parent[v]
        return v

    for face in faces.tolist():
        for a, b in combinations(face, 2):
            parent[root(a)] = root(b)
    roots = [root(face[0]) for face in faces.tolist()]
    labels = face_components(faces, 60).tolist()
    for i, j in combinations(range(25), 2):
        assert (labels[i] == labels[j]) == (roots[i] == roots[j])
