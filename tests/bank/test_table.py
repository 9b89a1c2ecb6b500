"""Tables of answers: what follows from them, and that they belong to one weight file."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from fauna.bank.table import TABLE, BankTable, Drawing, DrawnBy, read_table, similarity, table_beside, write_table
from fauna.bank.view import view_of
from fauna.errors import FaunaError
from fauna.types import BankReadout

VALUES = torch.tensor([[1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [5.0, 5.0]])


def table() -> BankTable:
    """Two ants made of slots 0 and 1, a bee of slots 1 and 2, and an eel that nobody trained on."""
    return BankTable(
        "abc",
        ("ant/00000", "ant/00004", "files/bee/1", "eel/00001"),
        ("ant", "ant", "bee", "eel"),
        np.array([True, True, True, False]),
        np.array([[0, 1], [0, 1], [1, 2], [2, 0]]),
        np.array([[0.75, 0.25], [0.25, 0.75], [0.5, -0.5], [1.0, 0.0]]),
        DrawnBy(7, 64),
    )


def test_means_over_a_species_pictures():
    assert table().kinds == ("ant", "bee", "eel")
    usage = table().usage(4)
    assert usage.tolist() == [[0.5, 0.5, 0, 0], [0, 0.5, 0.5, 0], [0, 0, 1, 0]]
    assert table().codes(VALUES).tolist() == [[0.75, 0.25], [0.25, 0.75], [0.0, 1.0], [0.0, -1.0]]
    assert table().species_codes(VALUES).tolist() == [[0.5, 0.5], [0.0, 1.0], [0.0, -1.0]]
    assert [table().is_trained(kind) for kind in table().kinds] == [True, True, False]


def test_cosines():
    rows = table().species_codes(VALUES)
    matrix = similarity(rows, rows)
    assert np.diag(matrix) == pytest.approx(1.0)
    assert matrix[1, 2] == pytest.approx(-1.0)
    assert matrix[0, 1] == pytest.approx(np.sqrt(0.5))
    assert np.isfinite(similarity(rows, 0 * rows)).all()


def test_a_file_keeps_everything_and_is_the_same_twice(tmp_path):
    for name in ("a.safetensors", "b.safetensors"):
        write_table(table(), tmp_path / name)
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()
    again = read_table(tmp_path / "a.safetensors")
    for name in ("weights_sha256", "names", "species", "zoo"):
        assert getattr(again, name) == getattr(table(), name)
    for name in ("trained", "slots", "weights"):
        assert np.array_equal(getattr(again, name), getattr(table(), name))
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.safetensors", "b.safetensors"]


def test_a_table_belongs_to_one_weight_file(tmp_path):
    assert table_beside(tmp_path / "weights.safetensors", "abc") is None
    write_table(table(), tmp_path / TABLE)
    found = table_beside(tmp_path / "weights.safetensors", "abc")
    assert found is not None
    assert found.names == table().names
    assert table_beside(tmp_path / "weights.safetensors", "other") is None


@pytest.mark.parametrize("damage", [lambda content: content[:40], lambda content: b"", lambda content: b"x" * 200])
def test_a_damaged_table_is_refused_in_one_line(tmp_path, damage):
    write_table(table(), tmp_path / TABLE)
    (tmp_path / TABLE).write_bytes(damage((tmp_path / TABLE).read_bytes()))
    with pytest.raises(FaunaError, match=r"^bank table: expected .*; make it anew$"):
        read_table(tmp_path / TABLE)


def answer(slots, weights) -> BankReadout:
    made = torch.tensor([weights]) @ VALUES[slots]
    return BankReadout(made, torch.tensor([weights]), torch.tensor([slots]))


def test_a_view_names_slots_species_and_pictures():
    view = view_of(answer([1, 0], [0.25, 0.75]), VALUES, table(), species=2, pictures=2)
    assert [(each.slot, round(each.weight, 2)) for each in view.slots] == [(0, 0.75), (1, 0.25)]
    assert view.slots[0].species[0] == ("ant", 1.0)
    assert dict(view.slots[1].species) == {"ant": 0.5, "bee": 0.5}
    assert view.species is not None
    assert [name for name, _ in view.species] == ["ant", "bee", "eel"]
    assert view.pictures is not None
    assert [each.name for each in view.pictures] == ["ant/00000", "ant/00004"]  # no bee: it cannot be drawn again
    assert view.pictures[0].similarity == pytest.approx(1.0)
    assert view.pictures[1].drawing == Drawing(7, 64, "ant", 4)


def test_pictures_of_files_are_named_where_the_zoo_drew_none():
    view = view_of(answer([1, 0], [0.25, 0.75]), VALUES, replace(table(), zoo=None), species=1, pictures=9)
    assert view.pictures is not None
    assert [each.name for each in view.pictures] == ["ant/00000", "ant/00004", "files/bee/1"]
    assert {each.drawing for each in view.pictures} == {None}


def test_without_a_table_slots_have_no_names():
    view = view_of(answer([1, 0], [0.5, -0.5]), VALUES, None, species=2, pictures=2)
    assert [(each.slot, each.species) for each in view.slots] == [(0, ()), (1, ())]
    assert (view.species, view.pictures) == (None, None)
