"""Everything at once and for real: no stand-ins."""

import json
import struct
from dataclasses import replace

import trimesh
from PIL import Image

from fauna.export.joints import JOINT_NAMES
from tests.reconstruct.test_schema import SCHEMA_FILE, check


def test_a_photograph_becomes_files(loaded, drawn, tmp_path):
    output = replace(
        loaded.settings.output,
        formats=("glb", "obj", "ply"),
        finetune_iterations=2,
        refine_steps=2,
        turntable=False,
    )
    asked = replace(loaded, settings=replace(loaded.settings, output=output))
    result = asked.reconstruct(drawn[0], mask=drawn[1], name="horse")
    folder = result.save(tmp_path / "horse")
    content = json.loads((folder / "result.json").read_text())
    check(content, json.loads(SCHEMA_FILE.read_text()))
    assert content["status"] == "ok"
    assert {"refined", "texture_finetuned"} <= set(content["flags"])
    assert set(content["animal"]["bone_angles"]) < set(JOINT_NAMES)
    assert set(content["files"]) == {each.name for each in folder.iterdir()}
    glb = (folder / "model.glb").read_bytes()
    length = struct.unpack("<I", glb[12:16])[0]
    document = json.loads(glb[20 : 20 + length])
    assert len(document["skins"][0]["joints"]) == len(JOINT_NAMES)
    faces = content["animal"]["mesh"]["faces"]
    for kind in ("glb", "obj", "ply"):
        assert len(trimesh.load(folder / f"model.{kind}", force="mesh").faces) == faces
    assert "viewer.html" in content["files"]
    with Image.open(folder / "preview.png") as picture:
        assert picture.size[0] == 6 * output.preview_cell


def test_the_animal_in_memory_is_that_of_the_files(loaded, drawn):
    result = loaded.reconstruct(drawn[0], mask=drawn[1], name="horse")
    animal = result.rigged()
    assert animal.name == "horse"
    assert len(animal.faces) == len(result.fit.out.base.faces)
    assert animal.texture is result.texture
    assert animal.texture.image.shape == (64, 64, 3)
