"""Khronos' validator has nothing to say about what is written. Needs node and the folder of its npm package."""

import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fauna.export import write_glb
from tests.export.objects import animal, atlas

MODULES = os.environ.get("FAUNA_GLTF_VALIDATOR")
"""Folder in which ``npm install gltf-validator`` was run."""

COUNT = int(os.environ.get("FAUNA_GLTF_EXPORTS", "12"))
"""Number of random exports."""


def _random(seed: int):
    """Any body, pose, size and look; names that need escaping."""
    generator = np.random.default_rng(seed)
    bend = float(generator.choice([0.0, 0.3, 1.0, 3.1]))
    name = ("horse", 'a "b"\\', "жираф", "")[seed % 4]
    size = float(generator.uniform(0.1, 5.0))
    rigged = animal(
        seed, name=name, back_height=size, bend=bend, attached=bool(seed % 5), detail=int(generator.integers(1, 4))
    )
    look = seed % 3
    if look == 0:
        return replace(rigged, texture=atlas(rigged.faces, seed, size=int(2 ** generator.integers(4, 8))))
    if look == 1:
        return replace(rigged, colours=generator.random(rigged.vertices.shape))
    return replace(rigged, faces=rigged.faces[generator.integers(0, 40) :])


@pytest.mark.skipif(MODULES is None or shutil.which("node") is None, reason="needs node and FAUNA_GLTF_VALIDATOR")
def test_nothing_to_complain(tmp_path):
    assert MODULES is not None
    paths = []
    for seed in range(COUNT):
        paths.append(tmp_path / f"{seed}.glb")
        write_glb(_random(seed), paths[-1])
    script = Path(__file__).with_name("validate.js")
    done = subprocess.run(
        ["node", str(script), MODULES, *map(str, paths)], capture_output=True, text=True, check=True, timeout=600
    )
    reports = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(reports) == COUNT
    for report in reports:
        assert report["messages"] == [], report["file"]
