"""A tenth of the bad inputs; all of them run with ``python -m tests.reconstruct.bad_inputs``."""

import hashlib

import pytest

from tests.reconstruct.bad_inputs import COUNT, MAKERS, bad_inputs, complaints, put

SUBSET = 30


def test_inputs_are_the_same_every_time_and_of_every_kind():
    first, again = bad_inputs(SUBSET), bad_inputs(SUBSET)
    assert first == again
    assert {each.name.split("-", 1)[1].split(".")[0] for each in first} == set(MAKERS)
    assert len({hashlib.sha256(each.content).digest() for each in first}) > SUBSET - 4
    assert COUNT == 300


@pytest.mark.parametrize("start", [0])
def test_bad_inputs_are_refused_with_a_reason_or_handled(call, tmp_path, start):
    inputs = bad_inputs(SUBSET, start=start)
    paths = put(tmp_path / "in", inputs)
    code, said, wrong, _ = call(*paths, "-o", "results", "--no-finetune", "--no-texture")
    assert code == 1
    assert wrong == ""
    assert "Traceback" not in said
    assert complaints(inputs, tmp_path / "results") == []
