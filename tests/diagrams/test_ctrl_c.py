"""Ctrl-C is a question at first; the oracle is a real signal."""

import signal
import threading

import pytest

from diagrams.ctrl_c import until_ctrl_c


def test_tells_that_it_was_pressed():
    with until_ctrl_c() as pressed:
        assert not pressed()
        signal.raise_signal(signal.SIGINT)
        assert pressed()


def test_pressed_twice_it_interrupts():
    with pytest.raises(KeyboardInterrupt), until_ctrl_c() as pressed:
        signal.raise_signal(signal.SIGINT)
        assert pressed()
        signal.raise_signal(signal.SIGINT)


def test_all_is_as_before_afterwards():
    before = signal.getsignal(signal.SIGINT)
    with until_ctrl_c():
        assert signal.getsignal(signal.SIGINT) is not before
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_another_thread_is_not_told():
    """Oracle: Python's own rule: signals are of the main thread."""
    told = []

    def ask():
        with until_ctrl_c() as pressed:
            told.append(pressed())

    before = signal.getsignal(signal.SIGINT)
    thread = threading.Thread(target=ask)
    thread.start()
    thread.join()
    assert told == [False]
    assert signal.getsignal(signal.SIGINT) is before
