"""Finds the largest pushes that the robot recovers from, all around it.

The limit of each gait, moment, direction and set of mechanisms is searched, as
in the Nadia paper's Fig. 10, or the Atlas paper's Fig. 6.  Finished trials are
kept: after Ctrl-C or a power cut, the same flags and --out with the folder
continue the sweep.  Directions, mechanisms and moments can be added to a
folder in the same way.

Examples:
    python scripts/envelope.py --quick
    python scripts/envelope.py --quick --plant lipm --directions 24
    python scripts/envelope.py --protocol atlas_fig6
    python scripts/envelope.py --directions "0,90" --mechanisms icp_only,step
    python scripts/envelope.py --robot path/robot.yaml --out envelopes/mine
    python scripts/envelope.py --plot-only envelopes/mine
    python scripts/envelope.py --limit --robot path/robot.yaml
"""

import nadia_balance.scripts  # noqa: F401  (first, for Ctrl-C)

# isort: split
import argparse
import contextlib
import os
import shlex
import sys
from concurrent.futures import Executor
from datetime import datetime
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed

from nadia_balance.diagrams.simulation import until_ctrl_c
from nadia_balance.results.folder import prepare_folder
from nadia_balance.scripts import INTERRUPTED, command_line
from nadia_balance.scripts.envelope_sweep import run, table
from nadia_balance.scripts.envelope_sweep.flags import sweep_flags, sweep_from
from nadia_balance.scripts.envelope_sweep.physical import limit_lines
from nadia_balance.scripts.envelope_sweep.report import said_lines, write_report
from nadia_balance.scripts.envelope_sweep.rows import (
    DATABASE,
    EXPORTS,
    Rows,
    opened,
)
from nadia_balance.scripts.envelope_sweep.sweep import HEADROOM, Sweep
from nadia_balance.scripts.envelope_sweep.trial import DIAGRAMS
from nadia_balance.scripts.envelope_sweep.workers import open_workers

SCENARIO, COMMAND = "scenario.yaml", "command.txt"


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; returns the exit code of --help."""
    argv = sys.argv[1:] if argv is None else argv
    parser = _parser()
    args = parser.parse_args(argv)
    args.command = shlex.join(["envelope.py", *argv])
    with contextlib.ExitStack() as stack:
        with parser.refusing():
            if args.plot_only is not None:
                return _plot_only(args.plot_only)
            if args.limit:
                return _limit(sweep_from(args))
            job = _prepare(args, stack)
        return _run(*job)


def _complain(error: Exception, code: int) -> int:
    command_line.complain("envelope.py", error)
    return code


_FLAGS: dict[str, command_line.Flags] = {
    "running": {
        "from": {
            "dest": "known",
            "type": command_line.place,
            "metavar": "FOLDER",
            "help": f"march up from {HEADROOM:g} m/s below the limits that an "
            "earlier sweep found in FOLDER, not from zero",
        },
        "workers": {
            "type": int,
            "help": "trials at a time on this machine (default: %(default)s, "
            "its cores)",
        },
        "scheduler": {"help": "of a Dask cluster to run on, tcp://host:port"},
        "timeout": {
            "type": command_line.finite,
            "default": Sweep.timeout,
            "help": "wall time after which a trial counts as hung (default: "
            "%(default)g) [s]",
        },
    },
    "output": {
        "out": {
            "type": command_line.place,
            "help": "folder for the results (default: envelopes/<date>_"
            f"<protocol>); one with a {DATABASE} goes on",
        },
        "plot-only": {
            "type": command_line.place,
            "metavar": "FOLDER",
            "help": f"only write what follows from FOLDER/{DATABASE}",
        },
        "limit": {
            "action": "store_true",
            "help": "simulate no push: print what no controller can recover "
            "from",
        },
    },
}


def _parser() -> command_line.CommandLine:
    parser = command_line.CommandLine(
        prog="envelope.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="Exit code: 0 done, 1 the workers or the disk failed, "
        "2 bad input, 3 undecided (the runs are too short for some limits, or "
        "nobody was pushed), 130 Ctrl-C.",
    )
    sweep_flags(parser)
    for group, flags in _FLAGS.items():
        command_line.add_flags(parser, group, flags)
    parser.set_defaults(workers=_cores())
    return parser


def _cores() -> int:
    affinity = getattr(os, "sched_getaffinity", None)  # macOS has none
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def _prepare(
    args: argparse.Namespace, stack: contextlib.ExitStack
) -> tuple[Sweep, Rows, Executor, int]:
    """Checks the flags, then opens the workers and the files of a run.

    Raises:
        ValueError: a flag is invalid, or the rows are of another sweep.
        OSError: a file is missing, or cannot be written.
    """
    sweep = sweep_from(args)
    if args.known is not None:
        with opened(_given("from", args.known)) as rows:
            found = table.found_limits(rows.identity, rows.all())
        known = {c: limit.recovered for c, limit in found.items() if limit}
        sweep.known_limits = known
    # Building a diagram checks the robot and the blocks, too.
    firsts = {cell.situation.scenario: cell for cell in sweep.cells()}
    for cell in firsts.values():
        DIAGRAMS[sweep.plant](sweep.walk(cell, replica=0))
    out = args.out
    if out is None:
        now = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
        out = Path("envelopes") / f"{now}_{args.protocol}"
    workers = open_workers(args.workers, args.scheduler)
    executor, slots = stack.enter_context(workers)
    folder = prepare_folder(out)
    rows = stack.enter_context(opened(folder, sweep.identity()))
    texts = (
        yaml_dump_typed(scenario, child_name=name)
        for name, scenario in sweep.scenarios.items()
    )
    (folder / SCENARIO).write_text("".join(texts), encoding="utf-8")
    with open(folder / COMMAND, "a", encoding="utf-8") as file:
        file.write(f"{args.command}\n")
    return sweep, rows, executor, slots


def _run(sweep: Sweep, rows: Rows, executor: Executor, slots: int) -> int:
    """Runs the sweep and writes the report, also after an error or Ctrl-C."""
    folder, code = rows.path.parent, command_line.DONE
    start = run.progress_of(run.searches_of(sweep, rows.all()))
    command_line.say(*_plan_lines(sweep, start, slots), f"into {folder}")
    with until_ctrl_c() as stopped:
        try:
            with run.progress_bar(start) as show:
                if not run.run_sweep(
                    sweep, rows, executor, slots, show, stopped
                ):
                    code = INTERRUPTED
        except RuntimeError as error:
            code = _complain(error, command_line.FAILED)
        if rows.all():
            try:
                if _report(rows, [SCENARIO, COMMAND]).undecided:
                    code = code or command_line.UNDECIDED
            except ValueError as error:  # no trial was decided
                code = _complain(error, code or command_line.UNDECIDED)
        if code in (command_line.FAILED, INTERRUPTED):
            command_line.say(
                f"the same flags and --out {folder} go on from here"
            )
    return code


def _plan_lines(sweep: Sweep, progress: run.Progress, slots: int) -> list[str]:
    """Lines with the numbers of limits and trials."""
    limits = "limit" if progress.cells == 1 else "limits"
    numbers = (
        f"{name} {len(values)}"
        for name, values in (
            ("gaits", sweep.scenarios),
            ("mechanisms", sweep.mechanisms),
            ("moments", sweep.at),
            ("directions", sweep.directions),
        )
    )
    return [
        f"{progress.cells} {limits} to find ({' x '.join(numbers)})",
        f"about {progress.total - progress.done} trials to run, {slots} at a "
        f"time; {progress.done} are there already",
    ]


def _plot_only(folder: Path) -> int:
    with opened(_given("plot_only", folder)) as rows:
        prepare_folder(folder)
        undecided = _report(rows, []).undecided
    return command_line.UNDECIDED if undecided else command_line.DONE


def _given(flag: str, folder: Path) -> Path:
    if not (folder / DATABASE).is_file():
        raise ValueError(
            f"{flag} = {str(folder)!r}: must be a folder with a {DATABASE}"
        )
    return folder


def _limit(sweep: Sweep) -> int:
    """Prints the limits of a point mass with the robot's parameters."""
    most, directions = sweep.mechanisms[-1], sweep.directions
    for cell in sweep.cells():
        if (cell.mechanisms, cell.direction_deg) == (most, directions[0]):
            walk, at = sweep.walk(cell, replica=0), cell.situation
            command_line.say(*limit_lines(walk, at, sweep.plant, directions))
    return command_line.DONE


def _report(rows: Rows, written: list[str]) -> table.LimitTable:
    """Writes the report; prints the table, and the names of all files.

    Raises:
        ValueError: no trial was decided.
        OSError: a file cannot be written.
    """
    folder = rows.path.parent
    rows.export(folder)
    limits = table.limit_table(rows.identity, rows.all(), folder / SCENARIO)
    written = [*write_report(folder, limits), DATABASE, *EXPORTS, *written]
    command_line.say(
        *said_lines(limits), f"wrote {folder}/{{{', '.join(written)}}}"
    )
    return limits


if __name__ == "__main__":
    sys.exit(main())
