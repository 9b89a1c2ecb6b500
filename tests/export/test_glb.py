"""What is written, read back by a player written for these tests, by the project's reader and by trimesh."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

import fauna
from fauna.export import glb_bytes, write_glb
from fauna.export.joints import JOINT_NAMES, NUM_JOINTS
from fauna.export.surface import linear_from_srgb, normals
from fauna.models3d.glb import accessor, read_glb
from tests.export.objects import animal, atlas
from tests.export.reader import Player


def textured(seed: int):
    plain = animal(seed)
    return replace(plain, texture=atlas(plain.faces, seed))


@pytest.mark.parametrize("seed", range(6))
def test_the_pose_survives(seed):
    rigged = animal(seed)
    player = Player.of(glb_bytes(rigged))
    assert np.abs(player.vertices() - rigged.vertices).max() < 1e-5
    for time in (0.0, 0.3, 1.0):
        assert np.abs(player.vertices("photo", time) - rigged.pose(rigged.photo)).max() < 1e-5


def test_every_clip_survives():
    rigged = animal(7)
    player = Player.of(glb_bytes(rigged))
    assert [clip["name"] for clip in player.document["animations"]] == ["photo", *(c.name for c in rigged.clips)]
    for clip in rigged.clips:
        assert player.duration(clip.name) == pytest.approx(clip.times[-1])
        for frame in (0, len(clip.times) // 3, len(clip.times) - 1):
            expected = rigged.pose(clip.rotations[frame], clip.translation[frame])
            shown = player.vertices(clip.name, float(np.float32(clip.times[frame])))
            assert np.abs(shown - expected).max() < 1e-4


def test_a_clip_leaves_no_joint_to_the_clip_before():
    document = Player.of(glb_bytes(animal(7))).document
    joints = document["skins"][0]["joints"]
    for clip in document["animations"]:
        targets = [(channel["target"]["node"], channel["target"]["path"]) for channel in clip["channels"]]
        assert sorted(targets) == sorted([*((joint, "rotation") for joint in joints), (joints[0], "translation")])


def test_neighbouring_quaternions_are_near():
    player = Player.of(glb_bytes(animal(7)))
    for clip in player.document["animations"]:
        for channel in clip["channels"]:
            if channel["target"]["path"] == "rotation":
                values = player.array(clip["samplers"][channel["sampler"]]["output"])
                assert (np.einsum("fk,fk->f", values[1:], values[:-1]) > 0).all()


def test_a_texture_splits_vertices_and_keeps_the_surface():
    rigged = textured(1)
    player = Player.of(glb_bytes(rigged))
    assert np.abs(player.vertices("photo") - rigged.pose(rigged.photo)[rigged.texture.vertex]).max() < 1e-5
    np.testing.assert_array_equal(player.indices(), rigged.texture.faces)
    np.testing.assert_allclose(player.attribute("TEXCOORD_0"), rigged.texture.uv, atol=1e-7)
    assert player.attribute("COLOR_0") is None
    view = player.document["bufferViews"][player.document["images"][0]["bufferView"]]
    png = player.binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(png))), rigged.texture.image)


def test_colours_are_linear():
    plain = animal(2)
    colours = np.random.default_rng(0).random(plain.vertices.shape)
    player = Player.of(glb_bytes(replace(plain, colours=colours)))
    np.testing.assert_allclose(player.attribute("COLOR_0"), linear_from_srgb(colours), atol=1e-6)
    known = linear_from_srgb(np.array([[0.0, 0.04045, 0.5], [1.0, 2.0, -1.0]]))
    np.testing.assert_allclose(known, [[0.0, 0.0031308, 0.2140411], [1.0, 1.0, 0.0]], atol=1e-6)


def test_weights_and_joints():
    player = Player.of(glb_bytes(animal(3)))
    joints, weights = player.attribute("JOINTS_0"), player.attribute("WEIGHTS_0")
    assert joints.shape[1] == weights.shape[1] == 4
    assert (joints[weights == 0] == 0).all()
    assert joints.max() < NUM_JOINTS
    np.testing.assert_allclose(weights.astype(np.float64).sum(axis=1), 1.0, atol=2e-7)


def test_the_scene():
    rigged = animal(3)
    document = Player.of(glb_bytes(rigged)).document
    mesh_node = next(index for index, node in enumerate(document["nodes"]) if "mesh" in node)
    assert mesh_node in document["scenes"][0]["nodes"]
    assert set(document["nodes"][mesh_node]) == {"name", "mesh", "skin"}  # placed by its skeleton alone
    assert [document["nodes"][joint]["name"] for joint in document["skins"][0]["joints"]] == list(JOINT_NAMES)
    assert document["asset"]["generator"] == f"fauna {fauna.__version__}"
    assert document["asset"]["extras"]["unit"] == "metre"
    assert document["asset"]["extras"]["metres_per_unit"] == rigged.metres_per_unit
    assert "doubleSided" not in document["materials"][0]


def test_an_open_surface_shows_both_sides():
    closed = animal(3)
    document = Player.of(glb_bytes(replace(closed, faces=closed.faces[1:]))).document
    assert document["materials"][0]["doubleSided"]


def test_normals_are_unit_and_point_outward():
    rigged = animal(3)
    found = normals(rigged.vertices, rigged.faces)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-6)
    own = trimesh.Trimesh(rigged.vertices, rigged.faces, process=False)
    assert (np.einsum("vk,vk->v", found, own.vertex_normals) > 0.9).all()


def test_extremes_and_alignment():
    player = Player.of(glb_bytes(textured(4)))
    for index, entry in enumerate(player.document["accessors"]):
        values = player.array(index)
        assert entry["min"] == values.min(axis=0).tolist()
        assert entry["max"] == values.max(axis=0).tolist()
        assert player.document["bufferViews"][entry["bufferView"]]["byteOffset"] % 4 == 0


def test_large_meshes_have_wide_indices():
    rigged = animal(0)
    many = 70_000 // len(rigged.faces) + 1
    big = replace(rigged, texture=atlas(rigged.faces, 0))
    assert Player.of(glb_bytes(big)).indices().dtype == np.uint16
    faces = np.concatenate([rigged.faces] * many)
    assert Player.of(glb_bytes(replace(rigged, faces=faces, texture=atlas(faces, 0)))).indices().dtype == np.uint32


def test_the_projects_reader_and_trimesh_read_it(tmp_path: Path):
    rigged = textured(5)
    path = tmp_path / "animal.glb"
    write_glb(rigged, path)
    assert list(tmp_path.iterdir()) == [path]
    file = read_glb(path)
    attributes = file.document["meshes"][0]["primitives"][0]["attributes"]
    positions = accessor(file, attributes["POSITION"])
    np.testing.assert_allclose(positions, rigged.vertices[rigged.texture.vertex], atol=1e-6)
    scene = trimesh.load(path, process=False)
    (mesh,) = scene.geometry.values()
    np.testing.assert_allclose(mesh.vertices, positions, atol=1e-6)
    np.testing.assert_array_equal(mesh.faces, rigged.texture.faces)
    assert mesh.visual.material.baseColorTexture.size == (64, 64)


def test_the_same_animal_gives_the_same_bytes():
    assert glb_bytes(textured(6)) == glb_bytes(textured(6))
