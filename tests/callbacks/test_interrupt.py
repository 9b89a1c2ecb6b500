"""An interrupt waits for the end of a step; a second one does not. The hooks are tried by the signal tests of the command."""

import os
import signal
import threading

import pytest

from fauna.callbacks.interrupt import Interrupt


def two_steps(callback: Interrupt, finished: list[str], interrupts: int) -> None:
    with callback.listening():
        callback.raise_if_asked()
        for _ in range(interrupts):
            os.kill(os.getpid(), signal.SIGINT)
        finished.append("first")
        callback.raise_if_asked()
        finished.append("second")


@pytest.mark.parametrize(("interrupts", "reached"), [(1, ["first"]), (2, [])])
def test_one_waits_for_the_end_of_the_step_and_two_do_not(interrupts, reached):
    before, finished = signal.getsignal(signal.SIGINT), []
    with pytest.raises(KeyboardInterrupt):
        two_steps(Interrupt(), finished, interrupts)
    assert finished == reached
    assert signal.getsignal(signal.SIGINT) is before


def test_without_an_interrupt_nothing_happens():
    finished: list[str] = []
    two_steps(Interrupt(), finished, 0)
    assert finished == ["first", "second"]


def test_another_thread_trains_without_listening():
    seen = []

    def work() -> None:
        with Interrupt().listening():
            seen.append(signal.getsignal(signal.SIGINT))

    before = signal.getsignal(signal.SIGINT)
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [before]
