"""Work beside the calling thread: order, laziness, errors, an orderly end, and thread counts that stay where they belong."""

import threading
import time

import numba
import pytest
import torch

from fauna.errors import FaunaError
from fauna.threads import describe_cpu, in_background, set_threads


@pytest.fixture
def two_threads():
    set_threads(2)
    yield
    set_threads(1)


@pytest.mark.parametrize(("workers", "ahead"), [(1, 0), (1, 1), (1, 4), (3, 2), (3, 50)])
def test_results_are_those_of_map(workers, ahead):
    def slow_if_even(number):
        time.sleep(0.004 * (number % 2 == 0))
        return number * number

    assert list(in_background(slow_if_even, range(20), workers=workers, ahead=ahead)) == [n * n for n in range(20)]


def test_no_more_than_so_many_are_begun():
    begun = []
    results = in_background(begun.append, range(100), workers=2, ahead=3)
    time.sleep(0.02)
    assert begun == []
    for taken in range(1, 6):
        next(results)
        time.sleep(0.02)
        assert len(begun) == taken + 3
    results.close()
    time.sleep(0.02)
    assert len(begun) == 8


def test_items_are_prepared_while_the_caller_is_busy():
    def slow(number):
        time.sleep(0.03)
        return number

    results = in_background(slow, range(6), workers=1, ahead=2)
    next(results)
    time.sleep(0.1)
    start = time.perf_counter()
    assert [next(results), next(results)] == [1, 2]
    assert time.perf_counter() - start < 0.02


def test_an_error_is_raised_where_its_result_is_asked_for():
    def fails_at_three(number):
        if number == 3:
            raise FaunaError("photo x expects something, got nothing; mend it")
        return number

    results = in_background(fails_at_three, range(10), workers=2, ahead=4)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(FaunaError, match="photo x expects"):
        next(results)
    assert not running()


@pytest.mark.parametrize("end", ["closed", "dropped", "exhausted"])
def test_threads_end_with_the_iterator(end):
    results = in_background(lambda number: number, range(5), workers=3, ahead=2)
    next(results)
    assert running()
    if end == "closed":
        results.close()
    elif end == "exhausted":
        assert list(results) == [1, 2, 3, 4]
    else:
        del results
    assert not running()


def running() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name.startswith("fauna")]


@pytest.mark.usefixtures("two_threads")
def test_workers_use_one_thread_and_the_caller_keeps_its_own():
    def counts(_):
        return torch.get_num_threads(), numba.get_num_threads()

    before = counts(0)
    assert list(in_background(counts, range(4), workers=2, ahead=2)) == [(1, 1)] * 4
    assert counts(0) == before
    assert before[0] == 2


@pytest.mark.usefixtures("two_threads")
def test_background_work_does_not_change_the_bits_of_the_caller():
    weight = torch.randn(64, 64, 3, 3, generator=torch.Generator().manual_seed(0))
    image = torch.randn(2, 64, 40, 40, generator=torch.Generator().manual_seed(1))

    def work(_):
        return torch.nn.functional.conv2d(image, weight)

    alone = [work(0) for _ in range(3)]
    beside = []
    for _ in in_background(work, range(6), workers=2, ahead=3):
        beside.append(work(0))
    assert all(torch.equal(each, alone[0]) for each in alone + beside)


def test_the_processor_is_described_in_one_line():
    line = describe_cpu()
    assert line.startswith(f"{torch.get_num_threads()} thread")
    assert "\n" not in line
