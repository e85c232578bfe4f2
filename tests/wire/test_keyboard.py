"""Keys walk the robot as they do in the page of a live session."""

import numpy as np

from nadia_balance.wire import keyboard

LIMITS = np.array([[-0.2, -0.14, -0.5], [0.42, 0.14, 0.5]])


def test_each_key_moves_one_command_by_a_step():
    """Oracle: by hand: the steps of the page's sliders."""
    for keys, expected in (
        ("w", [0.05, 0.0, 0.0]),
        ("ss", [-0.1, 0.0, 0.0]),
        ("Qa?", [0.0, 0.02, 0.1]),
        ("ed", [0.0, -0.02, -0.1]),
        ("wwwwwwwwwwwww", [0.4, 0.0, 0.0]),  # 0.42 is no whole step
        ("wwwwwwwwwssssssss", [0.0, 0.0, 0.0]),
        ("wwax", [0.0, 0.0, 0.0]),
        ("wwsas", [0.0, 0.0, 0.1]),
    ):
        command = keyboard.commanded(np.zeros(3), keys, LIMITS)
        np.testing.assert_allclose(command, expected, err_msg=keys)


def test_without_a_terminal_no_key_is_pressed(monkeypatch):
    """As in a pipe, or where there is no input at all."""
    for stdin in (None, open(__file__)):
        monkeypatch.setattr("sys.stdin", stdin)
        with keyboard.pressed_keys() as keys:
            assert keys() == ""
    stdin.close()


def test_keys_of_a_terminal_come_one_by_one(monkeypatch):
    """Oracle: a terminal of this machine, which is as before afterwards."""
    import os
    import termios

    ours, theirs = os.openpty()
    before = termios.tcgetattr(theirs)
    with open(theirs, closefd=False) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        with keyboard.pressed_keys() as keys:
            assert keys() == ""
            os.write(ours, b"wa")
            assert keys() == "wa"
            assert keys() == ""
            # Arrows, F1, Delete and Escape are no letters.
            os.write(ours, b"\x1b[Bd\x1b[1;5Aq\x1bOP\x1b[3~\x1b")
            assert keys() == "dq"
    assert termios.tcgetattr(theirs) == before
    os.close(ours)
    os.close(theirs)
