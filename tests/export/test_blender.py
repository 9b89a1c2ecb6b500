"""Blender shows what we skin. Needs a Python with ``bpy``."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from fauna.export import write_glb
from fauna.export.joints import JOINT, JOINT_NAMES
from tests.export.objects import animal

PYTHON = os.environ.get("FAUNA_BLENDER_PYTHON")


@pytest.mark.skipif(PYTHON is None, reason="needs FAUNA_BLENDER_PYTHON, a Python with bpy")
def test_blender_imports_bones_actions_and_poses(tmp_path):
    assert PYTHON is not None
    rigged = animal(3)
    write_glb(rigged, tmp_path / "animal.glb")
    wanted = {clip.name: float(clip.times[len(clip.times) // 3]) for clip in rigged.clips} | {"photo": 0.5}
    script = str(Path(__file__).with_name("blender_poses.py"))
    arguments = [PYTHON, script, str(tmp_path / "animal.glb"), json.dumps(wanted), str(tmp_path / "posed.json")]
    subprocess.run(arguments, check=True, capture_output=True, timeout=300)
    found = json.loads((tmp_path / "posed.json").read_text())
    assert set(found["bones"]) == set(JOINT_NAMES)
    assert found["actions"] == sorted(wanted)
    for name in ("head", "tail", "front_left_upper", "hind_right_foot"):
        along = rigged.frames[JOINT[name], :, 1]
        np.testing.assert_allclose(found["bones"][name], [along[0], -along[2], along[1]], atol=1e-5)
    expected = {"photo": rigged.pose(rigged.photo)} | {
        clip.name: rigged.pose(clip.rotations[len(clip.times) // 3], clip.translation[len(clip.times) // 3])
        for clip in rigged.clips
    }
    for name, vertices in found["posed"].items():
        assert np.abs(np.array(vertices) - expected[name]).max() < 1e-4, name
