"""Ctrl-C while a program imports Drake ends it without a traceback.

A program imports this module first: until its `main` begins, Ctrl-C ends it as
the system does, without the traceback of a half imported Drake.
"""

import signal
import sys
from pathlib import Path

_PROGRAMS = (
    "benchmark",
    "control",
    "envelope",
    "estimate",
    "export_mcap",
    "new_robot",
    "push",
    "robot",
    "simulate",
    "single_pushes",
    "tour",
    "_m",  # python -m
)
if (
    Path(sys.argv[0]).stem.removeprefix("nadia-").replace("-", "_") in _PROGRAMS
    and signal.getsignal(signal.SIGINT) is signal.default_int_handler
):
    signal.signal(signal.SIGINT, signal.SIG_DFL)
