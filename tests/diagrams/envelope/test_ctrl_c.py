"""Ctrl-C is a question at first; the oracle is a real signal."""

import signal

import pytest

from diagrams.envelope.ctrl_c import until_ctrl_c


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
