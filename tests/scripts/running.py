"""Running a script in this process, and looking at what it says."""

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


def summary_of(folder: Path) -> dict:
    return json.loads((folder / "summary.json").read_text("utf-8"))


def as_program(
    module: str, *argv, cwd: Path, path: Path = ROOT
) -> subprocess.CompletedProcess:
    """Runs a module of the scripts as a program of its own in `cwd`.

    It finds the modules in `path` before all others.
    """
    return subprocess.run(
        [
            sys.executable,
            "-m",
            f"nadia_balance.scripts.{module}",
            *map(str, argv),
        ],
        cwd=cwd,
        env=environment(path),
        capture_output=True,
        text=True,
    )


def environment(path: Path = ROOT) -> dict[str, str]:
    """Finds our modules from anywhere, after those in `path`."""
    paths = f"{path}{os.pathsep}{ROOT}"
    return {**os.environ, "PYTHONPATH": paths, "MPLBACKEND": "Agg"}
