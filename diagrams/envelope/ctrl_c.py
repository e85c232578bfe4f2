"""Ctrl-C as a question to ask, rather than an exception anywhere."""

import contextlib
import signal
from collections.abc import Callable, Iterator


@contextlib.contextmanager
def until_ctrl_c() -> Iterator[Callable[[], bool]]:
    """Yields what tells whether Ctrl-C was pressed.

    Pressed once more, it raises KeyboardInterrupt as ever.
    """
    pressed: list[bool] = []

    def press(*_: object) -> None:
        pressed.append(True)
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, press)
    try:
        yield lambda: bool(pressed)
    finally:
        signal.signal(signal.SIGINT, before)
