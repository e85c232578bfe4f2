"""Keys of a terminal, without a wait for them."""

import contextlib
import os
import re
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator

from nadia_balance.core.math.arrays import Array
from nadia_balance.view.live_controls import COMMANDS, HALT_KEY, slider_step

# As in the page of a live session: key, which command, and in which sense.
_MOVES = {
    key.removeprefix("Key").lower(): (i, sign)
    for i, keys in enumerate(COMMANDS.values())
    for key, sign in zip(keys, (-1.0, 1.0), strict=True)
}
_HALT = HALT_KEY.removeprefix("Key").lower()
# What a terminal sends for arrows and function keys ends with a letter.
_ESCAPES = re.compile(r"\x1b(\[[0-9;]*[A-Za-z~]|O[A-Z]|.)?", re.DOTALL)
HELP = "W S forward, A D turn, Q E sideways, X stop walking"


@contextlib.contextmanager
def pressed_keys() -> Iterator[Callable[[], str]]:
    """Reads single keys of the terminal, if there is one.

    Yields:
        A function that returns the keys since its last call.
    """
    if sys.stdin is None or not sys.stdin.isatty():
        yield lambda: ""
        return
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    tty.setcbreak(terminal)

    def keys() -> str:
        ready, _, _ = select.select([terminal], [], [], 0.0)
        pressed = os.read(terminal, 64) if ready else b""
        return _ESCAPES.sub("", pressed.decode(errors="ignore"))

    try:
        yield keys
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def commanded(velocity: Array, keys: str, limits: Array) -> Array:
    """A velocity command after some keys.

    Args:
        velocity: before, forward, left [m/s], turn [rad/s] (3,).
        keys: that were pressed, see HELP; others do nothing.
        limits: least and most of the command (2, 3).

    Returns:
        The command, within its limits (3,).
    """
    velocity = velocity.copy()
    least, greatest = limits
    for key in keys.lower():
        if key == _HALT:
            velocity[:] = 0.0
        elif key in _MOVES:
            i, sign = _MOVES[key]
            step = slider_step(min(-least[i], greatest[i]))
            # Whole steps, so that as many back lead to 0.
            steps = round(velocity[i] / step) + sign
            if least[i] - 1e-9 <= steps * step <= greatest[i] + 1e-9:
                velocity[i] = steps * step
    return velocity
