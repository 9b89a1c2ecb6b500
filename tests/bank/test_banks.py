import math

import pytest
import torch
from torch.nn import functional as F

from fauna.bank.base import shape_code, slot_entropy
from fauna.bank.category import CategoryBank
from fauna.bank.none import NoBank
from fauna.bank.semantic import SemanticBank
from fauna.bank.single import SingleBank
from fauna.errors import FaunaError
from fauna.types import BankReadout


def semantic(**changes) -> SemanticBank:
    torch.manual_seed(0)
    options = {
        "num_slots": 12,
        "top_k": 5,
        "value_dim": 6,
        "query_dim": 9,
        "key_init": 0.05,
        "value_init": 0.05,
        "num_value_prototypes": 7,
    }
    return SemanticBank(**{**options, **changes})


def query(batch: int = 4, dim: int = 9) -> torch.Tensor:
    return torch.randn(batch, dim, generator=torch.Generator().manual_seed(1))


def brute_force(bank: SemanticBank, one: torch.Tensor) -> torch.Tensor:
    """Eq. 1 for one query, slot by slot."""
    cosine = [float(F.cosine_similarity(one, key, dim=0)) for key in bank.keys.detach()]
    chosen = sorted(range(len(cosine)), key=lambda k: -cosine[k])[: bank.top_k]
    total = sum(abs(cosine[k]) for k in chosen)
    return sum(cosine[k] / total * bank.values[k] for k in chosen)


@pytest.mark.parametrize("top_k", [1, 5, 12])
def test_semantic_bank_equals_brute_force(top_k):
    bank = semantic(top_k=top_k)
    readout = bank(query(), None)
    assert readout.weights is not None
    for row in range(4):
        torch.testing.assert_close(readout.embedding[row], brute_force(bank, query()[row]))
    torch.testing.assert_close(readout.weights.abs().sum(1), torch.ones(4))
    assert (readout.weights.diff(dim=1) <= 0).all()


def test_negative_similarities_keep_their_sign():
    readout = semantic(top_k=12)(query(), None)
    assert readout.weights is not None
    assert (readout.weights < 0).any()


def test_a_small_bank_uses_all_its_slots():
    readout = semantic(num_slots=2, top_k=10)(query(), None)
    assert readout.weights is not None
    assert readout.weights.shape == (4, 2)


def test_scale_of_the_query_does_not_matter():
    bank = semantic()
    torch.testing.assert_close(bank(query() * 30, None).embedding, bank(query(), None).embedding)


@pytest.mark.parametrize(("num_slots", "prototypes", "different"), [(60, 7, 7), (4, 7, 4), (12, None, 12)])
def test_values_start_as_repeated_prototypes(num_slots, prototypes, different):
    bank = semantic(num_slots=num_slots, num_value_prototypes=prototypes)
    assert bank.values.unique(dim=0).shape[0] == different
    assert bank.values.abs().max() <= 0.05
    assert torch.equal(bank.values[different:], bank.values[: num_slots - different][: num_slots - different])


def test_gradient_reaches_chosen_slots_only():
    bank = semantic(num_value_prototypes=None)
    readout = bank(query(1), None)
    readout.embedding.square().sum().backward()
    assert readout.slots is not None
    assert bank.keys.grad is not None
    assert bank.values.grad is not None
    chosen = torch.zeros(12, dtype=torch.bool)
    chosen[readout.slots[0]] = True
    assert torch.equal(bank.values.grad.abs().sum(1) > 0, chosen)
    assert torch.equal(bank.keys.grad.abs().sum(1) > 0, chosen)


def test_semantic_bank_gradients():
    bank = semantic(num_slots=7, top_k=3, num_value_prototypes=None).double()
    inputs = (query(2).double().requires_grad_(), bank.keys, bank.values)

    def embedding(query, keys, values):
        return torch.func.functional_call(bank, {"keys": keys, "values": values}, (query, None)).embedding

    assert torch.autograd.gradcheck(embedding, inputs)


def test_nothing_of_the_size_of_a_large_bank_is_kept_for_the_backward_pass():
    kept = []
    bank = semantic(num_slots=10_000)
    with torch.autograd.graph.saved_tensors_hooks(lambda tensor: kept.append(tensor) or tensor, lambda tensor: tensor):
        bank(query(), None)
    own = {parameter.data_ptr() for parameter in bank.parameters()}
    assert kept
    assert max(tensor.numel() for tensor in kept if tensor.data_ptr() not in own) <= 4 * 5 * 9


@pytest.mark.parametrize("name", ["num_slots", "top_k", "num_value_prototypes"])
def test_counts_must_be_positive(name):
    with pytest.raises(FaunaError, match=f"bank.{name} must be >= 1, got 0"):
        semantic(**{name: 0})


def test_category_bank_looks_up_and_refuses_unknown_species():
    bank = CategoryBank(num_categories=3, value_dim=6, init=0.05)
    readout = bank(query(), 2)
    assert torch.equal(readout.embedding, bank.values[2].expand(4, -1))
    assert readout.weights is None
    for category in (None, 3, -1):
        with pytest.raises(FaunaError, match=r"category index in 0..2"):
            bank(query(), category)
    with pytest.raises(FaunaError, match="num_categories"):
        CategoryBank(num_categories=0, value_dim=6, init=0.05)


def test_single_bank_answers_the_same_to_everyone():
    bank = SingleBank(value_dim=6, init=0.05)
    assert torch.equal(bank(query(), 0).embedding, bank.value.expand(4, -1))
    assert len(list(bank.parameters())) == 1


def test_no_bank_returns_the_query():
    bank = NoBank(query_dim=9)
    assert bank.value_dim == 9
    assert torch.equal(bank(query(), None).embedding, query())


def test_slot_entropy():
    readout = BankReadout(torch.zeros(2, 3), torch.tensor([[0.5, -0.5], [1.0, 0.0]]), torch.tensor([[0, 1], [0, 1]]))
    torch.testing.assert_close(slot_entropy(readout), torch.tensor([math.log(2), 0.0]))
    assert torch.equal(slot_entropy(BankReadout(torch.zeros(2, 3))), torch.zeros(2))


def test_code_of_a_batch_is_the_mean_or_that_of_any_one_photo():
    readout = semantic()(query(3), None)
    mean = readout.embedding.mean(dim=0)
    draws = [shape_code(readout, "one", torch.Generator().manual_seed(seed)) for seed in range(20)]
    photos = [next(i for i in range(3) if torch.equal(code, readout.embedding[i])) for code in draws]
    assert set(photos) == {0, 1, 2}
    assert torch.equal(shape_code(readout, "mean", torch.Generator()), mean)
    assert torch.equal(shape_code(readout, "one", None), mean)
