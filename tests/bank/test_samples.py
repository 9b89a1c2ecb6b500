"""Sampling, the command, and the table that ships."""

import json
import sys

import numpy as np
import pytest
import torch
from PIL import Image
from torch.nn import functional as F

from fauna.bank import command
from fauna.bank.census import take_census
from fauna.bank.none import NoBank
from fauna.bank.samples import sample_bank
from fauna.bank.table import read_table, table_beside
from fauna.data.sources import ZooPhotos
from fauna.errors import FaunaError
from fauna.evaluation.weights import file_digest
from fauna.pretrained.load import load_model
from fauna.pretrained.shipped import shipped_weights
from fauna.zoo.zoo import Zoo
from tests.runs import reference_run


@pytest.fixture(scope="module")
def model():
    return load_model(None, device="cpu")


def test_samples_are_seeded_and_do_not_depend_on_their_number(model):
    first, second, other = (sample_bank(model, "x", mixtures=n, seed=s) for n, s in ((3, 1), (2, 1), (2, 2)))
    slots = len(model.bank.values)
    assert len(first.samples) == slots + 6
    codes = {each.name: each.code for each in first.samples}
    assert all(torch.equal(codes[each.name], each.code) for each in second.samples)
    assert not torch.equal(codes["ten_00"], {each.name: each.code for each in other.samples}["ten_00"])
    assert torch.equal(codes["slot_07"], model.bank.values[7])


def test_mixtures_are_what_they_say(model):
    for sample in sample_bank(model, "x", mixtures=2, seed=0).samples:
        assert sum(sample.weights) == pytest.approx(1.0, abs=1e-5)
        assert min(sample.weights) >= 0
        assert len(set(sample.slots)) == len(sample.slots) == {"slot": 1, "ten": 10, "all": 60}[sample.kind]
        mixed = torch.tensor(sample.weights) @ model.bank.values[list(sample.slots)].detach()
        assert torch.allclose(mixed, sample.code, atol=1e-5)


def test_what_cannot_be_sampled(model):
    with pytest.raises(FaunaError, match="mixtures: expected a whole number from 0 to 1000, got -1"):
        sample_bank(model, "x", mixtures=-1, seed=0)
    own, model.bank = model.bank, NoBank(query_dim=320)
    try:
        with pytest.raises(FaunaError, match="expected a bank with slots, got NoBank"):
            sample_bank(model, "x", mixtures=0, seed=0)
    finally:
        model.bank = own


def test_the_table_that_ships_is_that_of_the_weights_that_ship(model):
    """After publishing weights: fauna-bank table data.source.members.models3d.root=FOLDER."""
    path = shipped_weights()
    table = table_beside(path, file_digest(path))
    assert table is not None, "make the table of the new weights: fauna-bank table"
    assert table.trained.sum() >= 1000
    assert {"camel", "pig", "wolf"} == {kind for kind in table.kinds if not table.is_trained(kind)}
    assert table.slots.max() < len(model.bank.values)
    assert np.abs(table.weights).sum(axis=1) == pytest.approx(1.0, abs=0.01)


def test_a_census_of_one_picture_is_what_the_model_answers(model):
    photo = ZooPhotos(seed=1, photos_per_species=1, image_size=256, species=["horse"]).categories()["horse"].train[0]
    made = take_census(model, [photo], trained=[True], weights_sha256="x")
    sample = Zoo(seed=1, image_size=256).sample("horse", 0)
    readout = model.reconstruct(sample.image, sample.mask, crop=False).readout
    code = torch.from_numpy(made.codes(model.bank.values)).float()
    assert F.cosine_similarity(code, readout.embedding).item() > 0.99  # half precision, and two at once in the encoder
    path = shipped_weights()
    table = table_beside(path, file_digest(path))
    assert table is not None
    known = table.names.index("horse/00000") if "horse/00000" in table.names else None
    if known is not None:
        shipped = torch.from_numpy(table.codes(model.bank.values)[known : known + 1]).float()
        assert F.cosine_similarity(code, shipped).item() > 0.99


# --- the command ---------------------------------------------------------------------------------------------------


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["fauna-bank", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            command.main()
        return int(stop.value.code or 0), *capsys.readouterr()

    return call


def test_sampling_from_the_command_line(run, tmp_path):
    run_folder = reference_run()
    code, _, _ = run("sample", "--checkpoint", run_folder, "--mixtures", 1)
    content = json.loads((tmp_path / "bank/result.json").read_text())
    assert code == (0 if content["status"] == "ok" else 1)
    assert content["schema"] == "fauna-bank-1"
    assert content["weights"] == file_digest(run_folder / "weights.safetensors")
    assert set(content["files"]) == {each.name for each in (tmp_path / "bank").iterdir()}
    assert [each["name"] for each in content["samples"]][-2:] == ["ten_00", "all_00"]
    stamp = (tmp_path / "bank/result.json").stat().st_mtime_ns
    assert "done before" in run("sample", "--checkpoint", run_folder, "--mixtures", 1)[1]
    assert (tmp_path / "bank/result.json").stat().st_mtime_ns == stamp
    code, _, said = run("sample", "--checkpoint", run_folder, "--mixtures", 2)
    assert (code, "holds something else; add --overwrite" in said) == (2, True)


def test_species_of_any_dataset_and_weights(run, tmp_path):
    pictures = ["data=zoo", "data.source.species=[cat,horse,wolf]", "--photos", 2, "--between", "cat", "horse"]
    code, said, _ = run("species", *pictures)
    assert (code, "3 species, 6 pictures" in said) == (0, True)
    content = json.loads((tmp_path / "species/result.json").read_text())
    assert content["similarity"]["cat"]["cat"] == pytest.approx(1.0)
    assert content["similarity"]["cat"]["wolf"] == content["similarity"]["wolf"]["cat"]
    assert [name for name, each in content["species"].items() if not each["trained"]] == ["wolf"]
    for name in ("similarity", "slots", "slot_shapes", "between"):
        with Image.open(tmp_path / f"species/{name}.png") as picture:
            assert len(np.unique(np.array(picture.convert("RGB")).reshape(-1, 3), axis=0)) > 20
    assert sorted(content["files"]) == sorted(each.name for each in (tmp_path / "species").iterdir())


def test_a_table_of_a_run(run, tmp_path):
    code, _, said = run("table", "-o", "t.safetensors", "data.source.members.models3d.root=nowhere")
    assert (code, len(said.splitlines())) == (2, 1)
    code, said, _ = run("table", "--checkpoint", reference_run(), "-o", "t.safetensors")
    assert (code, "training pictures" in said) == (0, True)
    made = read_table(tmp_path / "t.safetensors")
    assert made.trained.all()
    assert set(made.kinds) == {"long", "round"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["TASK", "--help"]),
        (["draw"], ["draw"]),
        (["sample", "--mixtures", "-1"], ["mixtures", "0 to 1000"]),
        (["sample", "--threads", "0"], ["--threads"]),
        (["sample", "--checkpoint", "nowhere"], ["checkpoint", "nowhere"]),
        (["species", "--between", "cat", "yeti"], ["between", "yeti"]),
        (["species", "data=nothing"], ["data", "nothing"]),
        (["species", "data=zoo", "--photos", "0"], ["--photos", ">= 1"]),
        (["table", "data.nothing=3"], ["data.nothing=3", "KEY=VALUE"]),
        (["table", "--held-out", "-1"], ["--held-out", ">= 0", "-1"]),
        (["table", "-o", "nowhere/bank.safetensors"], ["--out", "nowhere", "make the folder"]),
    ],
    ids=" ".join,
)
def test_bad_arguments_end_with_one_line(run, tmp_path, arguments, words):
    code, _, said = run(*arguments)
    assert (code, len(said.splitlines())) == (2, 1)
    for word in ("fauna: error: ", *words):
        assert word in said
    assert not list(tmp_path.iterdir())
