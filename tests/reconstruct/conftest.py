"""Stand-ins for what makes files, so that these tests are about everything else; and an animal to look at."""

import sys
from copy import copy
from dataclasses import replace
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image

from fauna.reconstruct import batch, command

BONES = tuple(f"bone_{index}" for index in range(20))


@pytest.fixture
def stand_ins(monkeypatch):
    """Replace export, texture and viewer; returns what they were asked for, in order."""
    asked: list[str] = []

    def tell(name, value=None):
        def part(*given, **named):
            asked.append(name)
            return value(*given, **named) if callable(value) else value

        return part

    def write_file(animal, path):
        path.write_bytes(animal.encode())

    def write_viewer(glb, path, *, title, facts, **more):
        path.write_text(f"{title} {dict(facts)}")

    def write_turntable(animal, folder, *, clip):
        (folder / "turntable.webp").write_bytes(b"turn")
        return folder / "turntable.webp"

    def replay(model, out, *texture, size):
        covered = torch.nn.functional.interpolate(out.renders.covered[None].float(), (size, size))[0] > 0
        return covered.float().expand(3, -1, -1), SimpleNamespace(fragments=SimpleNamespace(covered=covered))

    modules = {
        "fauna.export": {
            "rig_reconstruction": tell("rig", lambda model, out, *, name, texture: f"{name} {texture}"),
            "glb_bytes": lambda animal: animal.encode(),
            **{f"write_{kind}": tell(kind, write_file) for kind in ("glb", "obj", "ply")},
        },
        "fauna.export.joints": {"JOINT_NAMES": BONES, "JOINT_OF_BONE": tuple(range(20))},
        "fauna.texture": {
            "bake": tell("bake", lambda model, out, *, size, source, batch: f"texture of {size}"),
            "finetune": tell("finetune", lambda model, batch, out, *, iterations: copy(model)),
            "refine": tell("refine", lambda model, batch, out, *, steps: SimpleNamespace(out=out, iou_after=(0.5,))),
        },
        "fauna.texture.replay": {"render_network": replay, "render_textured": replay},
        "fauna.viewer": {
            "write_viewer": tell("viewer", write_viewer),
            "write_turntable": tell("turntable", write_turntable),
        },
    }
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    return asked


@pytest.fixture(scope="session")
def loaded():
    """The shipped model without fine-tuning."""
    import fauna

    found = fauna.load()
    output = replace(found.settings.output, finetune_iterations=0, texture_size=64, preview_cell=64)
    return replace(found, settings=replace(found.settings, output=output))


@pytest.fixture(scope="session")
def drawn():
    """An animal of the zoo: (256, 256, 3) picture and (256, 256) mask."""
    from fauna.zoo.zoo import Zoo

    sample = Zoo(seed=0, image_size=256).sample("horse", 0)
    return sample.image, sample.mask > 127


@pytest.fixture
def picture(tmp_path):
    """A picture of noise with a disc, and the disc's mask, as files."""

    def make(name="x.png", size=(96, 64), radius=20):
        width, height = size
        rows, columns = np.mgrid[:height, :width]
        disc = (rows - height / 2) ** 2 + (columns - width / 2) ** 2 < radius**2
        pixels = np.random.default_rng(0).integers(0, 255, (height, width, 3), dtype=np.uint8)
        pixels[disc] = (200, 120, 40)
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(pixels).save(path)
        return path, disc

    return make


@pytest.fixture
def call(tmp_path, monkeypatch, capsys, loaded, stand_ins):
    """Run the command with the loaded model: exit code, stdout, stderr."""
    loads = []

    def get(self):
        loads.append(self.settings)
        return replace(loaded, settings=self.settings)

    monkeypatch.setattr(batch.Loader, "get", get)
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["fauna-reconstruct", *map(str, arguments)])
        try:
            command.main()
        except SystemExit as stop:
            return int(stop.code or 0), *capsys.readouterr(), loads
        raise AssertionError("main always ends the program")

    return run
