"""The reader against hand-made files, byte layouts and slow references."""

import io
import struct

import numpy as np
import pytest
from PIL import Image
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from fauna.errors import FaunaError
from fauna.models3d.clips import Channel, world_from_node
from fauna.models3d.glb import accessor, read_glb
from fauna.models3d.load import load_model
from fauna.models3d.materials import linear_from_srgb
from fauna.models3d.model import pose
from tests.models3d.glb_writer import Writer

RNG = np.random.default_rng(0)
TURN = Rotation.from_euler("xyz", [0.3, -0.4, 1.1])


def bar(**changes) -> Writer:
    """Two joints, a strip of four triangles on them, and a rigid triangle that hangs on the second joint."""
    writer = Writer()
    verts = RNG.normal(size=(6, 3)).astype("f4")
    joints = np.tile([0, 1, 0, 0], (6, 1))
    shares = np.array([[255, 0], [200, 55], [128, 127], [55, 200], [0, 255], [10, 245]])
    strip = {
        "attributes": {
            "POSITION": writer.add(verts, "f4"),
            "JOINTS_0": writer.add(joints, "u2"),
            "WEIGHTS_0": writer.add(np.pad(shares, ((0, 0), (0, 2))), "u1", normalized=True),
            "TEXCOORD_0": writer.add(np.linspace(0, 65535, 12).reshape(6, 2), "u2", normalized=True),
        },
        "indices": writer.add(np.array([0, 1, 2, 1, 2, 3, 2, 3, 4, 3, 4, 5]), "u2"),
        "material": 0,
    }
    rigid = {"attributes": {"POSITION": writer.add(RNG.normal(size=(3, 3)), "f4")}}
    inverse = np.stack([np.eye(4), np.linalg.inv(_matrix(TURN, [0, 1, 0], 1.0))])
    times = writer.add(np.array([0.0, 1.0]), "f4")
    quaternions = writer.add(np.array([[0, 0, 0, 1], TURN.as_quat()]), "f4")
    pixels = io.BytesIO()
    Image.fromarray(np.full((2, 2, 3), (255, 128, 0), np.uint8)).save(pixels, "PNG")
    writer.document |= {
        "nodes": [
            {"name": "a", "children": [1], "scale": [2, 2, 2]},
            {"name": "b", "children": [3], "matrix": _matrix(TURN, [0, 1, 0], 1.0).T.ravel().tolist()},
            {"name": "skinned", "mesh": 0, "skin": 0, "translation": [9, 9, 9]},
            {"name": "tip", "mesh": 1, "translation": [0, 0, 1]},
        ],
        "meshes": [{"primitives": [strip]}, {"primitives": [rigid]}],
        "skins": [{"joints": [0, 1], "inverseBindMatrices": writer.add(inverse, "f4")}],
        "images": [{"bufferView": writer.view(pixels.getvalue()), "mimeType": "image/png"}],
        "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 0.5, 1, 1]}}],
        "animations": [
            {
                "name": "turn",
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "rotation"}}],
                "samplers": [{"input": times, "output": quaternions}],
            }
        ],
        **changes,
    }
    return writer


def _matrix(turn: Rotation, shift: list[float], scale: float) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = scale * turn.as_matrix(), shift
    return out


def test_pose_against_loops_over_vertices_and_joints(tmp_path):
    model = load_model(bar().write(tmp_path / "bar.glb"))
    assert model.name == "bar"
    assert model.node_names == ("a", "b", "skinned", "tip")
    local = model.clips["turn"].at(model.rest, 0.5)
    verts, world = pose(model, local)
    half = Rotation.from_rotvec(0.5 * TURN.as_rotvec())
    first = _matrix(half, [0, 0, 0], 2.0)
    second = first @ _matrix(TURN, [0, 1, 0], 1.0)
    np.testing.assert_allclose(world[0], first, atol=1e-6)
    np.testing.assert_allclose(world[1], second, atol=1e-6)
    for vertex in range(6):  # the node of a skinned mesh must not move it
        expected = np.zeros(4)
        for slot, bone in enumerate((first, second)):
            expected += (
                model.weights[vertex, slot] * bone @ model.inverse_bind[slot] @ np.append(model.verts[vertex], 1)
            )
        np.testing.assert_allclose(verts[vertex], expected[:3], atol=1e-6)
    tip = second @ _matrix(Rotation.identity(), [0, 0, 1], 1.0)
    for vertex in range(6, 9):
        np.testing.assert_allclose(verts[vertex], (tip @ np.append(model.verts[vertex], 1))[:3], atol=1e-6)
    np.testing.assert_allclose(model.weights.sum(1), 1)
    np.testing.assert_allclose(model.weights[1, :2], [200 / 255, 55 / 255], atol=1e-6)
    assert model.faces.tolist()[-1] == [6, 7, 8]


def test_bound_pose_undoes_the_inverse_bind_matrices(tmp_path):
    """Joints stand where the inverse bind matrices say, moved by the mesh's node, at the size they have at rest."""
    model = load_model(bar().write(tmp_path / "bar.glb"))
    scale = 2.0  # of node a, which the bind matrices do not know
    bound = _matrix(Rotation.identity(), [9, 9, 9], 1.0) @ np.linalg.inv(model.inverse_bind[1])
    np.testing.assert_allclose(model.bind_world[1], np.diag([scale, scale, scale, 1.0]) @ bound, atol=1e-5)
    np.testing.assert_allclose(
        np.linalg.inv(model.bind_world[1]) @ model.bind_world[3],
        _matrix(Rotation.identity(), [0, 0, 1], 1.0),
        atol=1e-6,
    )


def test_colours(tmp_path):
    model = load_model(bar().write(tmp_path / "bar.glb"))
    expected = linear_from_srgb(np.array([255, 128, 0]) / 255) * [1, 0.5, 1]
    uv = RNG.uniform(-1, 2, (5, 2))
    np.testing.assert_allclose(model.materials[0].at(uv), np.tile(expected, (5, 1)))
    assert model.face_materials.tolist() == [0, 0, 0, 0, -1]
    np.testing.assert_allclose(model.materials[-1].at(uv), 1)
    np.testing.assert_allclose(model.uv[5], [10 / 11, 1], atol=1e-4)


@pytest.mark.parametrize("value", [0.0, 0.01, 0.2, 0.7, 1.0])
def test_texture_lookup_is_bilinear_between_texel_centres(tmp_path, value):
    from fauna.models3d.materials import Material

    ramp = np.repeat(np.linspace(0, 1, 8)[None, :, None], 4, 0).repeat(3, 2)
    material = Material("ramp", np.ones(3), ramp)
    at = (0.5 + 7 * value) / 8
    np.testing.assert_allclose(material.at(np.array([[at, 0.3]])), value, atol=1e-12)


def test_strides_and_sparse_accessors():
    writer = Writer()
    rows = RNG.normal(size=(4, 5)).astype("f4")
    view = writer.view(rows.tobytes(), byteStride=20)
    writer.document["accessors"].append(
        {"bufferView": view, "byteOffset": 8, "componentType": 5126, "count": 4, "type": "VEC3"}
    )
    places, values = np.array([1, 3], "u2"), np.full((2, 3), 7, "f4")
    sparse = {
        "count": 2,
        "indices": {"bufferView": writer.view(places.tobytes()), "componentType": 5123},
        "values": {"bufferView": writer.view(values.tobytes())},
    }
    writer.document["accessors"] += [
        {"componentType": 5126, "count": 5, "type": "VEC3", "sparse": sparse},
        {**writer.document["accessors"][0], "sparse": sparse},
    ]
    glb = _parsed(writer)
    np.testing.assert_array_equal(accessor(glb, 0), rows[:, 2:])
    expected = np.zeros((5, 3))
    expected[[1, 3]] = 7
    np.testing.assert_array_equal(accessor(glb, 1), expected)
    mixed = rows[:, 2:].copy()
    mixed[[1, 3]] = 7
    np.testing.assert_array_equal(accessor(glb, 2), mixed)


@pytest.mark.parametrize(("dtype", "low"), [("i1", -1.0), ("u1", 0.0), ("i2", -1.0), ("u2", 0.0)])
def test_normalised_integers(dtype, low):
    writer = Writer()
    limits = np.iinfo(np.dtype(dtype))
    writer.add(np.array([limits.min, 0, limits.max]), dtype, normalized=True)
    np.testing.assert_allclose(accessor(_parsed(writer), 0), [low, 0, 1])


def _parsed(writer: Writer):
    import tempfile
    from pathlib import Path

    with tempfile.TemporaryDirectory() as folder:
        return read_glb(writer.write(Path(folder) / "file.glb"))


def test_interpolation_against_scipy():
    times = np.array([0.0, 0.4, 1.5])
    values = RNG.normal(size=(3, 3, 3))
    spline = Channel(0, "translation", "CUBICSPLINE", times, values)
    linear = Channel(0, "translation", "LINEAR", times, values[:, 1:2])
    step = Channel(0, "translation", "STEP", times, values[:, 1:2])
    turns = Rotation.random(3, random_state=1)
    quaternions = turns.as_quat()
    quaternions[1] *= -1  # the same rotation: the shorter arc must be taken
    rotation = Channel(0, "rotation", "LINEAR", times, quaternions[:, None])
    reference = Slerp(times, turns)
    for time in (-1.0, 0.0, 0.1, 0.4, 0.9, 1.5, 3.0):
        inside = np.clip(time, 0, 1.5)
        interval = 0 if inside < 0.4 else 1
        knots = slice(interval, interval + 2)
        hermite = CubicHermiteSpline(
            times[knots], values[knots, 1], np.stack([values[interval, 2], values[interval + 1, 0]])
        )
        np.testing.assert_allclose(spline.at(time), hermite(inside), atol=1e-12)
        np.testing.assert_allclose(linear.at(time), [np.interp(time, times, values[:, 1, i]) for i in range(3)])
        np.testing.assert_allclose(step.at(time), values[np.searchsorted(times, inside, side="right") - 1, 1])
        found = Rotation.from_quat(rotation.at(time))
        assert (found.inv() * reference(inside)).magnitude() < 1e-6


def test_parents_in_any_order():
    local = load_locals([[1, 0, 0], [0, 1, 0], [0, 0, 1]])
    world = world_from_node(local, np.array([2, 0, -1]))
    np.testing.assert_allclose(world[:, :3, 3], [[1, 0, 1], [1, 1, 1], [0, 0, 1]])
    with pytest.raises(FaunaError, match="expects nodes that form trees"):
        world_from_node(local, np.array([1, 0, -1]))


def load_locals(translations):
    from fauna.models3d.clips import Locals

    count = len(translations)
    return Locals(np.array(translations, float), np.tile([0.0, 0, 0, 1], (count, 1)), np.ones((count, 3)))


def _cut(data: bytes) -> bytes:
    return data[:-40]


def _magic(data: bytes) -> bytes:
    return b"ABCD" + data[4:]


def _version(data: bytes) -> bytes:
    return data[:4] + struct.pack("<I", 1) + data[8:]


def _json(data: bytes) -> bytes:
    return data[:20] + b"!" + data[21:]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_cut, "truncated"),
        (_magic, "the bytes 'glTF' at its start, got b'ABCD'"),
        (_version, "version 2, got version 1"),
        (_json, "a JSON chunk, got none"),
        (lambda data: data[:10], "the bytes 'glTF'"),
    ],
)
def test_broken_containers(tmp_path, spoil, message):
    path = tmp_path / "bad.glb"
    path.write_bytes(spoil(bar().bytes()))
    with pytest.raises(FaunaError, match=rf"bad.glb expects .*{message}") as raised:
        load_model(path)
    assert "\n" not in str(raised.value)


def _reach(writer: Writer) -> None:
    writer.document["accessors"][0]["count"] = 600


def _view(writer: Writer) -> None:
    writer.document["bufferViews"][0]["byteLength"] = 10**6


def _index(writer: Writer) -> None:
    writer.document["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 99


def _no_skin(writer: Writer) -> None:
    del writer.document["skins"]


def _joint(writer: Writer) -> None:
    writer.document["skins"][0]["joints"] = [0, 77]


def _draco(writer: Writer) -> None:
    writer.document["extensionsRequired"] = ["KHR_draco_mesh_compression"]


def _picture(writer: Writer) -> None:
    writer.document["images"][0]["bufferView"] = 0


def _keys(writer: Writer) -> None:
    writer.document["animations"][0]["samplers"][0]["output"] = 0


def _missing(writer: Writer) -> None:
    del writer.document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_reach, r"accessors\[0\] within its 72 bytes, got a reach of 7200"),
        (_view, r"bufferViews\[0\] within \d+ bytes"),
        (_index, "an index into accessors, got 99"),
        (_no_skin, "a skin"),
        (_joint, "an index into nodes, got 77"),
        (_draco, "no required extensions, got KHR_draco"),
        (_picture, r"a PNG or JPEG in images\[0\]"),
        (_keys, "2 keyframes of rotation"),
        (_missing, "sound glTF 2.0, got a broken entry"),
    ],
)
def test_broken_entries(tmp_path, spoil, message):
    writer = bar()
    spoil(writer)
    with pytest.raises(FaunaError, match=message) as raised:
        load_model(writer.write(tmp_path / "bad.glb"))
    assert "\n" not in str(raised.value)


def test_missing_file(tmp_path):
    with pytest.raises(FaunaError, match="expects a readable .glb file"):
        load_model(tmp_path / "none.glb")
