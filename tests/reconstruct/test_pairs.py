"""Morphs and transferred poses: the bodies, the folders, the refusals."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from PIL import Image
from scipy.spatial.transform import Rotation

from fauna.errors import FaunaError
from fauna.reconstruct.coat import Coat, crossfaded, in_box
from fauna.reconstruct.morph import Morph
from fauna.reconstruct.posing import PoseTransfer
from fauna.reconstruct.traits import Traits, embody, mixed, mixed_angles, traits_of


@pytest.fixture(scope="module")
def two(loaded):
    """Two animals without textures, of two species."""
    from fauna.zoo.zoo import Zoo

    zoo = Zoo(seed=0, image_size=256)
    output = replace(loaded.settings.output, texture_size=0, viewer=False, turntable=False)
    plain = replace(loaded, settings=replace(loaded.settings, output=output))
    found = []
    for species in ("horse", "dog"):
        sample = zoo.sample(species, 0)
        found.append(plain.reconstruct(sample.image, mask=sample.mask > 127, name=species))
    return plain, *found


# --- what is mixed -------------------------------------------------------------------------------------------------


def test_the_ends_are_the_photographs_own_bodies(two):
    _, first, second = two
    morph = Morph(name="m", first=first, second=second, frames=3)
    for share, result in ((0.0, first), (1.0, second)):
        body = morph.body(share)
        assert torch.equal(body.base.verts, result.fit.out.base.verts)
        assert torch.equal(body.posed.verts, result.fit.out.posed.verts)
    middle = morph.body(0.5)
    heights = [float(np.ptp(each.base.verts[:, 1].numpy())) for each in (morph.body(0.0), middle, morph.body(1.0))]
    assert min(heights[0], heights[2]) < heights[1] < max(heights[0], heights[2])
    assert morph.shares == [0.0, 0.5, 1.0]


def test_rotations_take_the_shortest_way_at_an_even_speed():
    rng = np.random.default_rng(0)
    first, second = (torch.from_numpy(rng.uniform(-1.0, 1.0, (20, 3))) for _ in range(2))
    assert mixed_angles(first, second, 0.0) == pytest.approx(first.numpy(), abs=1e-12)
    assert mixed_angles(first, second, 1.0) == pytest.approx(second.numpy(), abs=1e-12)
    turns = [Rotation.from_euler("XYZ", mixed_angles(first, second, share)) for share in (0.0, 0.25, 0.5, 1.0)]
    whole = (turns[0].inv() * turns[3]).magnitude()
    for share, turn in zip((0.25, 0.5), turns[1:3], strict=True):
        assert (turns[0].inv() * turn).magnitude() == pytest.approx(share * whole, abs=1e-9)
        assert (turn.inv() * turns[3]).magnitude() == pytest.approx((1 - share) * whole, abs=1e-9)


def test_traits_without_a_deformation_stay_without(two):
    traits = traits_of(two[1].fit.out)
    plain = Traits(traits.code, None, traits.angles)
    assert mixed(traits, plain, 0.5).geometry is None
    body = embody(two[0].model, plain)
    assert torch.equal(body.instance.verts[0], body.base.verts)


def test_a_coat_gives_back_its_own_colours_and_fades_linearly():
    rng = np.random.default_rng(1)
    places, colours = rng.uniform(-1, 1, (200, 3)), rng.uniform(0, 1, (200, 3))
    first, second = Coat(places, colours), Coat(places, 1.0 - colours)
    assert first.at(places) == pytest.approx(colours, abs=1e-3)
    assert crossfaded(first, second, 0.0, places) == pytest.approx(colours, abs=1e-3)
    assert crossfaded(first, second, 1.0, places) == pytest.approx(1.0 - colours, abs=1e-3)
    assert crossfaded(first, second, 0.5, places) == pytest.approx(np.full_like(colours, 0.5), abs=1e-3)


def test_places_fill_the_box_whatever_the_size():
    verts = torch.tensor([[-1.0, 0.0, -4.0], [1.0, 2.0, 4.0], [0.0, 1.0, 0.0]])
    assert in_box(verts, verts).tolist() == [[-1, -1, -1], [1, 1, 1], [0, 0, 0]]
    assert in_box(3 * verts + 1, 3 * verts + 1) == pytest.approx(in_box(verts, verts), abs=1e-6)


def test_a_transferred_pose_is_the_other_animals_on_the_own_body(two):
    _, first, second = two
    transfer = PoseTransfer("t", first, second)
    own, other = (each.fit.out for each in (first, second))
    assert torch.equal(transfer.out.pose.angles, other.pose.angles)
    assert torch.equal(transfer.out.base.verts, own.base.verts)
    assert not torch.equal(transfer.out.posed.verts, own.posed.verts)
    assert PoseTransfer("t", first, first).out.posed.verts == pytest.approx(own.posed.verts, abs=1e-6)


def test_a_pair_is_as_good_as_the_worse_one(two):
    _, first, second = two
    doubted = replace(second, status="not_a_quadruped", reason="hardly one", confidence=0.1)
    none = replace(second, status="no_animal", reason="dog: nothing", confidence=0.0, fit=None)
    assert PoseTransfer("t", first, second).ok
    pair = PoseTransfer("t", first, doubted)
    assert (pair.status, pair.reason, pair.confidence) == ("not_a_quadruped", "dog: hardly one", 0.1)
    assert (PoseTransfer("t", none, doubted).status, PoseTransfer("t", doubted, none).reason) == (
        "no_animal",
        "dog: nothing",
    )
    with pytest.raises(FaunaError, match="two reconstructed animals"):
        _ = PoseTransfer("t", first, none).fits
    other = replace(second, weights=replace(second.weights, sha256="0"))
    with pytest.raises(FaunaError, match="one model"):
        PoseTransfer("t", first, other)
    with pytest.raises(FaunaError, match="2 to 600"):
        Morph(name="m", first=first, second=second, frames=1)


# --- files and command ---------------------------------------------------------------------------------------------


@pytest.fixture
def photos(tmp_path):
    from fauna.zoo.zoo import Zoo

    zoo = Zoo(seed=0, image_size=128)
    for name, species in (("a", "horse"), ("b", "dog")):
        sample = zoo.sample(species, 0)
        Image.fromarray(sample.image).save(tmp_path / f"{name}.png")
        Image.fromarray(sample.mask).save(tmp_path / f"{name}_mask.png")
    (tmp_path / "text.jpg").write_text("no picture")
    return tmp_path


def small(monkeypatch):
    """Small films and sheets, so that a test is quick."""
    from fauna.reconstruct import command

    real = command.default_settings()
    fewer = replace(real.morph, keys=2, columns=2, cell=48, film_size=32)
    output = replace(real.output, preview_cell=48)
    monkeypatch.setattr(command, "default_settings", lambda: replace(real, morph=fewer, output=output))


@pytest.fixture
def run(photos, loaded, monkeypatch, capsys):
    import sys

    from fauna.reconstruct import batch, command

    small(monkeypatch)
    monkeypatch.setattr(batch.Loader, "get", lambda self: replace(loaded, settings=self.settings))
    monkeypatch.chdir(photos)

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["fauna-reconstruct", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            command.main()
        return int(stop.value.code or 0), *capsys.readouterr()

    return call


def read(path):
    from tests.reconstruct.test_schema import SCHEMA_FILE, check

    content = json.loads((path / "result.json").read_text())
    check(content, json.loads(SCHEMA_FILE.read_text()))
    assert set(content["files"]) == {each.name for each in path.iterdir()}
    return content


QUICK = ("--no-texture", "--no-viewer", "--no-turntable")


def test_a_morph_from_the_command_line(run, photos):
    code, said, _ = run("a.png", "b.png", "--morph", 3, *QUICK)
    assert (code, "a_to_b: ok" in said) == (0, True)
    content = read(photos / "out/a_to_b")
    application = content["application"]
    assert (application["kind"], application["frames"]) == ("morph", 3)
    assert [each["share"] for each in application["key_frames"]] == [0.0, 1.0]
    assert application["second"]["input"]["file"] == "b.png"
    assert content["input"]["file"] == "a.png"
    assert (content["status"], content["name"]) == ("ok", "a_to_b")
    assert (photos / "out/a_to_b/model_100.glb").read_bytes()[:4] == b"glTF"
    code, said, _ = run("a.png", "b.png", "--morph", 3, *QUICK)
    assert (code, "done before" in said) == (0, True)
    code, said, _ = run("a.png", "b.png", "--morph", 4, *QUICK)
    assert (code, "a_to_b: exists" in said) == (1, True)


def test_a_pose_from_the_command_line(run, photos):
    code, said, _ = run("a.png", "text.jpg", "--pose-from", "b.png", *QUICK)
    assert (code, "a_posed_as_b: ok" in said, "text_posed_as_b: unreadable" in said) == (1, True, True)
    content = read(photos / "out/a_posed_as_b")
    angles = content["application"]["second"]["animal"]["bone_angles"]
    assert content["application"]["bone_angles"] == angles
    assert content["animal"]["bone_angles"] != angles
    assert content["files"] == ["model.glb", "preview.png", "result.json"]
    assert read(photos / "out/text_posed_as_b")["application"]["first"]["status"] == "unreadable"


def test_a_defect_is_told_in_the_folder(run, photos, monkeypatch):
    def broken(*given, **named):
        raise RuntimeError("no film")

    from fauna.reconstruct import pair_files

    monkeypatch.setattr(pair_files, "write_video", broken)
    code, said, _ = run("a.png", "b.png", "--morph", 2, *QUICK)
    assert (code, "a_to_b: failed (a: RuntimeError: no film" in said) == (1, True)
    assert read(photos / "out/a_to_b")["files"] == ["result.json"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["a.png", "--morph", "3"], ["--morph", "two photographs", "1"]),
        (["a.png", "b.png", "--morph", "1"], ["morph", "2 to 600"]),
        (["a.png", "b.png", "--morph", "3", "--mask", "a_mask.png"], ["--mask", "two with --morph"]),
        (["a.png", "b.png", "--morph", "3", "--format", "obj"], ["--format", "glb"]),
        (["a.png", "b.png", "--morph", "3", "--pose-from", "a.png"], ["--morph", "--pose-from"]),
        (["a.png", "--pose-from", "nowhere.png"], ["--pose-from", "nowhere.png"]),
        (["a.png", "--pose-from", "b.png", "--mask", "a_mask.png", "--mask", "b_mask.png"], ["--mask", "--pose-from"]),
        (["a.png", "b.png", "--mask", "a_mask.png"], ["--mask", "one photograph"]),
    ],
    ids=" ".join,
)
def test_bad_arguments_end_with_one_line(run, arguments, words):
    code, _, said = run(*arguments)
    assert (code, len(said.splitlines())) == (2, 1)
    for word in ("fauna: error: ", *words):
        assert word in said
