"""The audit on a trainer of straw, and in a training that must not feel it."""

import csv
import logging
from types import SimpleNamespace

import torch
from lightning import LightningModule

from fauna.callbacks.mesh_audit import MeshAudit
from fauna.geometry.sparse_extraction import EmptyMeshError
from fauna.system import FaunaSystem
from fauna.types import BankReadout, Batch, Features
from tests.callbacks.test_callbacks import Straw
from tests.runs import assert_equal_bits, run, state, tiny


class Model:
    """Answers like a model whose shape misses as many components as it is told."""

    def __init__(self, missed) -> None:
        self.missed = list(missed)
        self.codes, self.jitters = [], []
        self.feature_space = SimpleNamespace(normalize=lambda features: features)
        self.shape = self

    def encode(self, batch):
        return batch.features

    def bank(self, query, category):
        return BankReadout(query)

    def audit(self, code, generator):
        self.codes.append(code)
        self.jitters.append(float(torch.rand((), generator=generator)))
        missed = self.missed.pop(0)
        if missed is None:
            raise EmptyMeshError("nothing")
        return missed


class System(FaunaSystem):
    def __init__(self, model) -> None:
        LightningModule.__init__(self)
        self.__dict__["model"] = model
        self.seed = 3


class Logger(list):
    def log_metrics(self, values, step):
        self.append((step, values))


def micro_batch():
    maps, tokens = torch.zeros(2, 1, 1), torch.zeros(2, 1, 1, 1)
    features = Features(torch.tensor([[1.0, 2.0], [3.0, 4.0]]), tokens, tokens)
    return Batch(torch.zeros(2, 3, 1, 1), maps, maps, maps, maps, 0, ("dog/1", "dog/2"), features)


def audited(missed, every, steps, callback=None):
    callback, model, logger = callback or MeshAudit(every_n_steps=every), Model(missed), Logger()
    for step in steps:
        trainer = Straw(step)
        trainer._loggers = [logger]
        callback.on_train_batch_end(trainer, System(model), None, [micro_batch()], 0)
    return callback, model, logger


def test_it_comes_every_so_many_steps_with_the_mean_code_and_the_jitter_of_the_step():
    _, model, logger = audited([0, 0, 0], 4, range(1, 15))
    assert logger == [(step, {"audit/missed_components": 0.0}) for step in (3, 7, 11)]
    assert all(torch.equal(code, torch.tensor([2.0, 3.0])) for code in model.codes)
    assert len(set(model.jitters)) == 3
    assert audited([0], 8, [8])[1].jitters == model.jitters[1:2]


def test_it_warns_once_also_after_a_resume(caplog):
    with caplog.at_level(logging.WARNING, logger="fauna"):
        callback, _, logger = audited([0, 2, 1], 1, range(1, 4))
        resumed = MeshAudit(every_n_steps=1)
        resumed.load_state_dict(callback.state_dict())
        audited([5], 1, [4], resumed)
    assert [values["audit/missed_components"] for _, values in logger] == [0.0, 2.0, 1.0]
    (record,) = caplog.records
    assert record.getMessage().startswith("step 1: the extraction overlooked 2 components of the base shape; raise ")


def test_an_empty_mesh_is_left_to_the_step():
    assert audited([None, 1], 1, [1, 2])[2] == [(1, {"audit/missed_components": 1.0})]


def test_training_does_not_feel_it(tmp_path):
    states = {}
    for every in (2, 1000):
        folder = tmp_path / str(every)
        run(folder, *tiny("trainer.max_steps=6", f"callbacks.mesh_audit.every_n_steps={every}"))
        states[every] = state(folder, 6)
    for part in ("state_dict", "optimizer_states"):
        assert_equal_bits(states[2][part], states[1000][part])
    with (tmp_path / "2" / "logs" / "metrics.csv").open() as handle:
        audits = [row["step"] for row in csv.DictReader(handle) if row["audit/missed_components"]]
    assert audits == ["1", "3", "5"]
