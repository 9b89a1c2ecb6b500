"""Files without a skeleton, read back by trimesh."""

from dataclasses import replace

import numpy as np
import trimesh

from fauna.export import write_obj, write_ply
from tests.export.objects import animal, atlas


def test_an_obj_with_its_texture(tmp_path):
    rigged = animal(0)
    rigged = replace(rigged, texture=atlas(rigged.faces, 0))
    write_obj(rigged, tmp_path / "zebra.obj")
    assert {path.name for path in tmp_path.iterdir()} == {"zebra.obj", "zebra.mtl", "zebra.png"}
    mesh = trimesh.load(tmp_path / "zebra.obj", process=False, force="mesh")
    posed = rigged.pose(rigged.photo)
    np.testing.assert_allclose(mesh.triangles, posed[rigged.faces], atol=1e-6)
    uv = mesh.visual.uv[mesh.faces]
    expected = rigged.texture.uv[rigged.texture.faces] * (1, -1) + (0, 1)
    np.testing.assert_allclose(uv, expected, atol=1e-6)
    np.testing.assert_array_equal(np.asarray(mesh.visual.material.image)[..., :3], rigged.texture.image)


def test_an_obj_without_texture(tmp_path):
    rigged = animal(1)
    write_obj(rigged, tmp_path / "a.obj")
    assert [path.name for path in tmp_path.iterdir()] == ["a.obj"]
    mesh = trimesh.load(tmp_path / "a.obj", process=False)
    np.testing.assert_allclose(mesh.triangles, rigged.pose(rigged.photo)[rigged.faces], atol=1e-6)


def test_a_ply_with_colours(tmp_path):
    rigged = animal(2)
    colours = np.random.default_rng(0).random(rigged.vertices.shape)
    write_ply(replace(rigged, colours=colours), tmp_path / "a.ply")
    mesh = trimesh.load(tmp_path / "a.ply", process=False)
    np.testing.assert_allclose(mesh.vertices, rigged.pose(rigged.photo), atol=1e-6)
    np.testing.assert_array_equal(mesh.faces, rigged.faces)
    np.testing.assert_array_equal(mesh.visual.vertex_colors[:, :3], (colours * 255).round().astype(np.uint8))
