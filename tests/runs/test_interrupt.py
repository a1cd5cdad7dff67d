"""The first Ctrl-C or SIGTERM asks, a second Ctrl-C stops, and the handler that was there before comes back."""

from __future__ import annotations

import os
import signal
import threading

import pytest

from onlinebayes.runs import BadInput, Interrupt, Stopped, heed


def press() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def test_the_first_asks_and_says_so_the_second_stops(capsys):
    before = signal.getsignal(signal.SIGINT)
    with Interrupt("stopping soon") as interrupt:
        assert not interrupt.requested
        press()
        assert interrupt.requested
        assert capsys.readouterr().err == "stopping soon\n"
        with pytest.raises(KeyboardInterrupt):
            press()
    assert signal.getsignal(signal.SIGINT) is before


def test_sigterm_asks_however_often_it_comes(capsys):
    before = signal.getsignal(signal.SIGTERM)
    with Interrupt("stopping soon") as interrupt:
        for _ in range(3):  # timeout sends two at once
            os.kill(os.getpid(), signal.SIGTERM)
        assert interrupt.requested
        with pytest.raises(KeyboardInterrupt):
            press()
    assert capsys.readouterr().err == "stopping soon\n"
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_block_may_be_given_up():
    done = []
    with Interrupt() as interrupt:
        press()
        with interrupt.giving_up():
            press()
            done.append("the block's end")
        done.append("what comes after")
    assert done == ["what comes after"]
    with pytest.raises(KeyboardInterrupt), Interrupt().giving_up():
        raise KeyboardInterrupt  # nobody had asked for a stop before


def test_a_block_that_heeds_ends_where_it_looks():
    interrupt, done = Interrupt(), []
    with interrupt.heeded():
        heed()
        interrupt.requested = True
        with pytest.raises(Stopped):
            heed()
    heed()  # outside of the block nobody is asked
    with interrupt.giving_up():
        done.append("before")
        with Interrupt().heeded():
            heed()  # the unwrap block's own
        heed()
        done.append("after")
    assert done == ["before"]
    with pytest.raises(Stopped), Interrupt().giving_up():
        raise Stopped  # by another one's request
    assert issubclass(Stopped, BadInput)  # who does without a fit that diverges does without one that was stopped


def test_without_a_message_it_is_silent(capsys):
    with Interrupt() as interrupt:
        press()
    assert interrupt.requested
    assert capsys.readouterr().err == ""


def test_outside_the_main_thread_it_does_nothing():
    before, entered = signal.getsignal(signal.SIGINT), []

    def elsewhere() -> None:
        with Interrupt() as interrupt:
            entered.append(interrupt.requested)

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert entered == [False]
    assert signal.getsignal(signal.SIGINT) is before
