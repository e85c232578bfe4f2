"""The programs of this package: `push`, `simulate`, `envelope` and others.

A program imports this module first, so that Ctrl-C ends it at once during the
other imports; Drake would report the exception as an error of its own.
"""

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

INTERRUPTED = 130  # exit code after Ctrl-C, or SIGTERM
_PROGRAMS = (
    *("benchmark", "envelope", "estimate", "new_robot", "push", "simulate"),
    "_m",  # of `python -m`
)


def _end(*_: object) -> None:
    os._exit(INTERRUPTED)


def _interrupt(*_: object) -> None:
    signal.raise_signal(signal.SIGINT)


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Makes Ctrl-C and SIGTERM raise KeyboardInterrupt in this block."""
    is_program = signal.getsignal(signal.SIGINT) is _end
    ends = (signal.SIGINT, signal.SIGTERM) if is_program else ()
    usual = signal.default_int_handler
    before = {number: signal.signal(number, usual) for number in ends}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_program() -> bool:
    """True if one of _PROGRAMS runs, by its file, its command or `-m`."""
    name = Path(sys.argv[0]).stem.removeprefix("nadia-").replace("-", "_")
    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    return usual and name in _PROGRAMS


if _is_program():
    signal.signal(signal.SIGINT, _end)
    signal.signal(signal.SIGTERM, _interrupt)  # as Ctrl-C
