"""What ships: the same numbers, nothing of the machine, everything named, and byte for byte reproducible."""

import json
import sys

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file

from fauna import FaunaModel
from fauna.errors import FaunaError
from fauna.io.checkpoint import read_weights
from fauna.models3d.catalogue import CATALOGUE
from fauna.pretrained import provenance as provenance_module
from fauna.pretrained import publish as module
from fauna.pretrained import shipped
from fauna.pretrained.provenance import provenance
from fauna.pretrained.publish import publish
from fauna.pretrained.scrub import refuse_paths, without_machine
from tests.pretrained.objects import publishable, report_of
from tests.runs import blob, reference_run

FILES = {shipped.WEIGHTS, shipped.CONFIG, shipped.METRICS, shipped.CARD, shipped.INDEX}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return publishable(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def report(run, tmp_path_factory):
    return report_of(run, tmp_path_factory.mktemp("report"))


@pytest.fixture
def limits(tmp_path):
    path = tmp_path / "limits.md"
    path.write_text("* Tails are missing.\n")
    return path


@pytest.fixture
def published(run, report, limits, tmp_path):
    folder = tmp_path / "published"
    publish(checkpoint=str(run), reports=[report], out=folder, hours=1.5, machine="two cores", limits=limits)
    return folder


def test_the_numbers_stay_and_the_machine_goes(run, published):
    assert {path.name for path in published.iterdir()} == FILES
    before, after = load_file(run), load_file(published / shipped.WEIGHTS)
    assert before.keys() == after.keys()
    assert all(before[name].dtype == after[name].dtype and torch.equal(before[name], after[name]) for name in before)
    for path in published.iterdir():
        assert b"/home/somebody" not in path.read_bytes(), path.name
    metadata = read_weights(published / shipped.WEIGHTS)[1]
    assert metadata["config"]["data"]["split_file"] is None
    assert metadata["config"]["out"] == "runs/blobs"
    assert metadata["stage"] == read_weights(run)[1]["stage"]


def test_equal_inputs_give_equal_bytes(run, report, limits, published, tmp_path):
    again = tmp_path / "again"
    publish(checkpoint=str(run), reports=[report], out=again, hours=1.5, machine="two cores", limits=limits)
    for name in FILES:
        assert (again / name).read_bytes() == (published / name).read_bytes(), name


def test_what_is_published_is_what_the_package_loads(published, monkeypatch):
    monkeypatch.setattr(shipped, "_folder", lambda: published)
    index = json.loads((published / shipped.INDEX).read_text())
    assert set(index["files"]) == FILES - {shipped.INDEX}
    assert not FaunaModel.from_pretrained().training
    assert "Tails are missing." in shipped.shipped_text(shipped.CARD)


def test_card_and_metrics_say_what_was_measured(report, published):
    card = (published / shipped.CARD).read_text()
    measured = json.loads((report / "report.json").read_text())
    content = json.loads((published / shipped.METRICS).read_text())["reports"][0]
    iou = measured["metrics"]["iou"]
    assert content["metrics"]["iou"]["value"] == round(iou["value"], 6)
    assert content["held_out"]["metrics"]["iou"]["n"] == 3
    assert f"| `iou` | {iou['value']:.3f} | {iou['low']:.3f} to {iou['high']:.3f} | {iou['n']} |" in card
    assert shipped.sha256((published / shipped.WEIGHTS).read_bytes()) in card
    for text in ("30 steps of 2 photographs", "1.5 hours on\ntwo cores", "long, round", "drawn by the package"):
        assert text in card, text
    assert "$" not in card


def test_a_checkpoint_loses_optimiser_and_discriminator(monkeypatch, limits, tmp_path, report):
    monkeypatch.setattr(module, "provenance", lambda config: provenance_module.Provenance())
    checkpoint = reference_run() / "checkpoints" / "step-0000030.ckpt"
    content = json.loads((report / "report.json").read_text())
    monkeypatch.setattr(module, "read_report", lambda folder, digest: content)
    publish(checkpoint=str(checkpoint), reports=[report], out=tmp_path, hours=1.0, machine="m", limits=limits)
    stored = load_file(tmp_path / shipped.WEIGHTS)
    assert {value.dtype for value in stored.values() if value.is_floating_point()} == {torch.float32}
    assert not [name for name in stored if name.startswith(("adversary", "encoder"))]
    state = torch.load(checkpoint, weights_only=True)["state_dict"]
    assert all(torch.equal(value, state[f"model.{name}"]) for name, value in stored.items())


def test_weights_that_are_too_large_are_refused(run, report, limits, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MAX_BYTES", 1000)
    with pytest.raises(FaunaError, match="^checkpoint: expected weights of at most"):
        publish(checkpoint=str(run), reports=[report], out=tmp_path / "x", hours=1.0, machine="m", limits=limits)
    assert not (tmp_path / "x").exists()


def test_a_report_of_other_weights_is_refused(report, limits, tmp_path):
    other = publishable(tmp_path / "other", fit_photos=7)
    with pytest.raises(FaunaError, match="^report: .*evaluate the file that is published"):
        publish(checkpoint=str(other), reports=[report], out=tmp_path / "x", hours=1.0, machine="m", limits=limits)
    with pytest.raises(FaunaError, match="^report: expected a folder with the report.json"):
        publish(checkpoint=str(other), reports=[tmp_path], out=tmp_path / "x", hours=1.0, machine="m", limits=limits)


# --- the head ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("already", [False, True])
@pytest.mark.parametrize("flip", [0.0, 1.0])
def test_the_head_is_at_plus_z(limits, tmp_path, already, flip):
    """A model measured with its head at -z is turned, also one that had been turned before; one at +z stays."""
    weights = publishable(tmp_path / "run", turned=already)
    reports = [report_of(weights, tmp_path / "a", flip=flip), report_of(weights, tmp_path / "b", flip=None)]
    out = tmp_path / "out"
    publish(checkpoint=str(weights), reports=reports, out=out, hours=1.0, machine="m", limits=limits)
    model, before = FaunaModel.from_pretrained(out), FaunaModel.from_pretrained(weights)
    assert model.turned == (already != bool(flip))
    assert ("turned by 180 degrees" in (out / shipped.CARD).read_text()) == model.turned
    assert "global_flip" not in (out / shipped.METRICS).read_text()
    image, mask = blob("long", 0, size=32)
    photo, same = (each.reconstruct(image, mask, crop=False, size=32) for each in (model, before))
    torch.testing.assert_close(photo.renders.silhouette, same.renders.silhouette, rtol=0, atol=1e-4)
    sign = torch.tensor([-1.0, 1.0, -1.0]) if flip else torch.ones(3)
    torch.testing.assert_close(photo.posed.verts, same.posed.verts * sign, rtol=0, atol=1e-4)


@pytest.mark.parametrize(
    ("flips", "got"), [((None,), "none of a dataset with truth"), ((0.0, 1.0), "reports that disagree")]
)
def test_where_the_head_is_must_be_known(run, limits, tmp_path, flips, got):
    reports = [report_of(run, tmp_path / str(place), flip=flip) for place, flip in enumerate(flips)]
    with pytest.raises(FaunaError, match=f"^report: expected one that tells .*{got}"):
        publish(checkpoint=str(run), reports=reports, out=tmp_path / "x", hours=1.0, machine="m", limits=limits)
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize("text", ["", " \n"])
def test_no_model_is_without_failures(run, report, tmp_path, text):
    (tmp_path / "none.md").write_text(text)
    with pytest.raises(FaunaError, match="^limits: .*empty"):
        publish(
            checkpoint=str(run),
            reports=[report],
            out=tmp_path / "x",
            hours=1.0,
            machine="m",
            limits=tmp_path / "none.md",
        )


@pytest.mark.parametrize(
    "text", ["on /home/me/box", "in `/data/x`", "at ~/runs", "C:\\runs\\1", "a=/x/y", "~me/runs", "file:///a/b"]
)
def test_absolute_paths_are_seen(text):
    with pytest.raises(FaunaError, match="^machine: expected no absolute path"):
        refuse_paths("machine", text)


@pytest.mark.parametrize(
    "text", ["https://arxiv.org/abs/2401.02400", "and/or", "runs/x", "1 / 2", r"(?:.*/)?([^/]+/v\d+)"]
)
def test_other_slashes_are_not(text):
    refuse_paths("machine", text)


def test_paths_under_other_keys_are_refused_by_name():
    with pytest.raises(FaunaError, match=r"^data.source.list\[1\]: .*/srv/b"):
        without_machine({"name": "x", "data": {"source": {"root": "/a", "list": ["c", "/srv/b"]}}})


# --- what it learned from ----------------------------------------------------------------------------------------

ZOO = {
    "_target_": "fauna.data.sources.ZooPhotos",
    "seed": 3,
    "photos_per_species": 9,
    "image_size": 64,
    "species": None,
}


def config_of(source: dict, **more: object) -> dict:
    return {"init_from": None, "data": {"source": source, "held_out": ["pig"]}, **more}


def test_models_are_listed_with_makers_and_licences(tmp_path):
    for name in ("Pig_Farm_A", "Horse", "Horse_White", "fox-cat", "fox-animations"):
        (tmp_path / f"{name}.glb").touch()
    models = {
        "_target_": "fauna.models3d.source.Models3D", "root": str(tmp_path), "seed": 0, "photos_per_model": 5, "image_size": 64,
        "views": "uniform", "models": None, "test_families": ["horse"], "include_cc_by": True,
    }  # fmt: skip
    both = {"_target_": "fauna.data.collections.PhotoCollections", "members": {"zoo": ZOO, "models3d": models}}
    found = provenance(config_of(both))
    assert found.zoo == {"seed": 3, "photos_per_species": 9, "image_size": 64}
    assert {(each.name, each.maker, each.licence) for each in found.trained} == {
        ("fox-animations", "Mesh2Motion", "CC0-1.0"), ("fox-cat", "David Revoy", "CC-BY-4.0"),
    }  # fmt: skip
    assert {each.name for each in found.held_out} == {"Pig_Farm_A", "Horse", "Horse_White"}
    assert {each.maker for each in found.held_out} == {"Quaternius"}
    assert all(each.species == CATALOGUE[each.name].species for each in found.trained + found.held_out)


def test_what_may_not_be_passed_on_is_refused():
    photos = {"_target_": "fauna.data.sources.FaunaFolder", "root": "/a", "photograph_pattern": "x"}
    with pytest.raises(FaunaError, match="^data.source: .*FaunaFolder"):
        provenance(
            config_of({"_target_": "fauna.data.collections.PhotoCollections", "members": {"a": ZOO, "b": photos}})
        )
    with pytest.raises(FaunaError, match="w.ckpt"):
        provenance(config_of(ZOO) | {"init_from": "w.ckpt"})


@pytest.mark.parametrize("same", [True, False])
def test_a_run_from_other_weights_needs_the_same_photographs(run, same):
    """The weights it started from are asked what they learned from."""
    config = read_weights(run)[1]["config"]
    config["init_from"] = str(run)
    if same:
        assert provenance(config) == provenance({**config, "init_from": None})
        return
    config["data"]["source"]["seed"] += 1
    with pytest.raises(FaunaError, match="^init_from: expected weights that learned from the same"):
        provenance(config)


def test_command(run, report, limits, tmp_path, monkeypatch, capsys):
    words = ["--checkpoint", run, "--report", report, "--report", report, "--hours", "1", "--limits", limits]
    arguments = ["publish", *map(str, words), "--out", str(tmp_path / "out")]
    monkeypatch.setattr(sys, "argv", [*arguments, "--machine", "two cores"])
    module.main()
    assert "SHA-256" in capsys.readouterr().out
    assert len(json.loads((tmp_path / "out" / shipped.METRICS).read_text())["reports"]) == 2
    with safe_open(tmp_path / "out" / shipped.WEIGHTS, framework="pt") as handle:
        assert set(handle.metadata()) == {"config", "stage", "turned", "species", "fauna", "encoder"}
    monkeypatch.setattr(sys, "argv", [*arguments, "--machine", "the box at /srv/gpu"])
    with pytest.raises(SystemExit) as stopped:
        module.main()
    assert stopped.value.code == 2
    assert capsys.readouterr().err.startswith("fauna: error: machine: expected no absolute path")
    assert "two cores" in (tmp_path / "out" / shipped.CARD).read_text()  # what was published before is whole


@pytest.mark.parametrize("change", [{"hours": float("nan")}, {"hours": -1.0}, {"machine": " "}])
def test_hours_and_machine_are_known(run, report, limits, tmp_path, change):
    given = {"hours": 1.0, "machine": "m"} | change
    with pytest.raises(FaunaError, match="^hours, machine: expected"):
        publish(checkpoint=str(run), reports=[report], out=tmp_path / "x", limits=limits, **given)
    assert not (tmp_path / "x").exists()


def test_an_interrupted_publication_leaves_no_model(run, report, limits, tmp_path, monkeypatch):
    """Also where one was before: its index would speak of files that are gone."""
    given = {"checkpoint": str(run), "reports": [report], "out": tmp_path, "machine": "m", "limits": limits}
    publish(**given, hours=1.0)
    original, written = module.write_atomically, []

    def stops(path, content):
        if written:
            raise KeyboardInterrupt
        written.append(path)
        original(path, content)

    monkeypatch.setattr(module, "write_atomically", stops)
    with pytest.raises(KeyboardInterrupt):
        publish(**given, hours=2.0)
    assert written
    monkeypatch.setattr(shipped, "_folder", lambda: tmp_path)
    with pytest.raises(FaunaError, match="no model ships"):
        FaunaModel.from_pretrained()
