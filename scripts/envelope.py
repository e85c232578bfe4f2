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
import shlex
import sys
from concurrent.futures import Executor
from datetime import datetime
from pathlib import Path

from dask.system import CPU_COUNT
from pydrake.common.yaml import yaml_dump_typed

from nadia_balance.diagrams.simulation import until_ctrl_c
from nadia_balance.results.folder import prepare_folder
from nadia_balance.scripts import INTERRUPTED, command_line
from nadia_balance.scripts.envelope_sweep import report, run, table
from nadia_balance.scripts.envelope_sweep.flags import sweep_flags, sweep_from
from nadia_balance.scripts.envelope_sweep.rows import (
    DATABASE,
    EXPORTS,
    Rows,
    opened,
)
from nadia_balance.scripts.envelope_sweep.sweep import HEADROOM, Sweep
from nadia_balance.scripts.envelope_sweep.trial import DIAGRAMS

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
                rows = stack.enter_context(opened(args.plot_only))
                prepare_folder(args.plot_only)
                return _report(rows, [])
            if args.limit:
                return _limit(sweep_from(args))
            job = _prepare(args, stack)
        return _run(*job)


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
            "default": CPU_COUNT,
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
    return parser


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
        with opened(args.known) as rows:
            found = table.found_limits(rows.identity, rows.all())
        known = {c: limit.recovered for c, limit in found.items() if limit}
        sweep.known_limits = known
    # Building a diagram checks the robot and the blocks, too.
    for cell in {cell.scenario: cell for cell in sweep.cells()}.values():
        DIAGRAMS[sweep.plant](sweep.walk(cell, replica=0))
    out = args.out
    if out is None:
        now = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
        out = Path("envelopes") / f"{now}_{args.protocol}"
    workers = run.open_workers(args.workers, args.scheduler)
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
    limits = "limit" if start.cells == 1 else "limits"
    numbers = f"gaits {len(sweep.scenarios)} x mechanisms "
    numbers += f"{len(sweep.mechanisms)} x moments {len(sweep.at)} x "
    numbers += f"directions {len(sweep.directions)}"
    command_line.say(
        f"{start.cells} {limits} to find ({numbers})",
        f"about {start.total - start.done} trials to run, {slots} at a "
        f"time; {start.done} are there already",
        f"into {folder}",
    )
    with until_ctrl_c() as stopped:
        try:
            with run.progress_bar(start) as show:
                if not run.run_sweep(
                    sweep, rows, executor, slots, show, stopped
                ):
                    code = INTERRUPTED
        except RuntimeError as error:
            command_line.complain("envelope.py", error)
            code = command_line.FAILED
        if rows.all():
            try:
                undecided = _report(rows, [SCENARIO, COMMAND])
                code = code or undecided
            except ValueError as error:  # no trial was decided
                command_line.complain("envelope.py", error)
                code = code or command_line.UNDECIDED
        if code in (command_line.FAILED, INTERRUPTED):
            command_line.say(
                f"the same flags and --out {folder} go on from here"
            )
    return code


def _limit(sweep: Sweep) -> int:
    """Prints the limits of a point mass with the robot's parameters."""
    most, directions = sweep.mechanisms[-1], sweep.directions
    for cell in sweep.cells():
        if (cell.mechanisms, cell.direction_deg) == (most, directions[0]):
            walk, at = sweep.walk(cell, replica=0), cell.situation
            lines = table.limit_lines(walk, at, sweep.plant, directions)
            command_line.say(*lines)
    return command_line.DONE


def _report(rows: Rows, written: list[str]) -> int:
    """Writes the report, prints the table and the names of all files.

    Returns the exit code: UNDECIDED if a cell has no limit.

    Raises:
        ValueError: no trial was decided.
        OSError: a file cannot be written.
    """
    folder = rows.path.parent
    rows.export(folder)
    limits = table.limit_table(rows.identity, rows.all(), folder / SCENARIO)
    names = report.write_report(folder, limits)
    names += [DATABASE, *EXPORTS, *written]
    lines = report.said_lines(limits)
    command_line.say(*lines, f"wrote {folder}/{{{', '.join(names)}}}")
    undecided = any(r.trials and r.recovered is None for r in limits.records)
    return command_line.UNDECIDED if undecided else command_line.DONE


if __name__ == "__main__":
    sys.exit(main())
