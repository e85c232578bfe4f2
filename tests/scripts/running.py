"""Running a script in this process, and looking at what it says."""

import errno
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from tests.source_files import ROOT


@dataclass
class Outcome:
    """What a user sees of a run."""

    code: int
    out: list[str]  # lines
    err: list[str]  # lines


def run_script(script, argv, capsys) -> Outcome:
    """Calls `script.main(argv)`; argparse may also end the program."""
    capsys.readouterr()
    try:
        code = script.main([str(arg) for arg in argv])
    except SystemExit as end:
        code = end.code
    said = capsys.readouterr()
    return Outcome(code, said.out.splitlines(), said.err.splitlines())


def assert_refused(outcome: Outcome, message: str):
    """Exit code 2, and one line of exactly this beginning."""
    assert outcome.code == 2
    (line,) = outcome.err
    assert line.partition(": ")[2].startswith(message)


def full_disk(*_):
    """Writes nothing: there is no room."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def summary_of(folder: Path) -> dict:
    return json.loads((folder / "summary.json").read_text("utf-8"))


def program(module: str, *argv, **options) -> subprocess.Popen:
    """Starts a module of the scripts as a program of its own."""
    return python("-m", f"nadia_balance.scripts.{module}", *argv, **options)


def python(*argv, **options) -> subprocess.Popen:
    """Starts Python; `options` are those of Popen."""
    pipe = subprocess.PIPE
    usual = {"env": environment(), "stdout": pipe, "stderr": pipe, "text": True}
    command = [sys.executable, *map(str, argv)]
    return subprocess.Popen(command, **(usual | options))


def ended(process: subprocess.Popen) -> Outcome:
    """Waits for the end of a program, at the most for five minutes."""
    out, err = process.communicate(timeout=300.0)
    out = (out or "").splitlines()  # it may go elsewhere
    return Outcome(process.returncode, out, err.splitlines())


def environment() -> dict[str, str]:
    """Finds our modules from anywhere."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
