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
from nadia_balance.scripts import INTERRUPTED
from nadia_balance.scripts.command_line import (
    BAD_INPUT,
    DONE,
    FAILED,
    UNDECIDED,
    CommandLine,
    complain,
    finite,
    place,
    program,
    say,
)
from nadia_balance.scripts.envelope_sweep.flags import sweep_flags, sweep_from
from nadia_balance.scripts.envelope_sweep.physical import limit_lines
from nadia_balance.scripts.envelope_sweep.report import said_lines, write_report
from nadia_balance.scripts.envelope_sweep.rows import (
    DATABASE,
    EXPORTS,
    Rows,
    opened,
)
from nadia_balance.scripts.envelope_sweep.run import (
    Progress,
    progress_bar,
    progress_of,
    run_sweep,
    searches_of,
)
from nadia_balance.scripts.envelope_sweep.sweep import HEADROOM, Sweep
from nadia_balance.scripts.envelope_sweep.table import (
    LimitTable,
    found_limits,
    limit_table,
)
from nadia_balance.scripts.envelope_sweep.trial import DIAGRAMS
from nadia_balance.scripts.envelope_sweep.workers import open_workers

SCENARIO, COMMAND = "scenario.yaml", "command.txt"


@program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`.

    Returns 0 done, 1 the workers or the disk failed, 2 bad input, 3 undecided,
    130 Ctrl-C.
    """
    argv = sys.argv[1:] if argv is None else argv
    args = _parser().parse_args(argv)
    args.command = shlex.join(["envelope.py", *argv])
    with contextlib.ExitStack() as stack:
        try:
            if args.plot_only is not None:
                return _plot_only(args.plot_only)
            if args.limit:
                return _limit(sweep_from(args))
            job = _prepare(args, stack)
        except (ValueError, OSError) as error:
            return _complain(error, BAD_INPUT)
        try:
            return _run(*job)
        except OSError as error:
            return _complain(error, FAILED)


def _complain(error: Exception, code: int) -> int:
    complain("envelope.py", error)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = CommandLine(
        prog="envelope.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="Exit code: 0 done, 1 the workers or the disk failed, "
        "2 bad input, 3 undecided (the runs are too short for some limits, or "
        "nobody was pushed), 130 Ctrl-C.",
    )
    sweep_flags(parser)
    parser.add_argument(
        "--from",
        dest="known",
        type=place,
        metavar="FOLDER",
        help=f"march up from {HEADROOM:g} m/s below the limits that an earlier "
        "sweep found in FOLDER, not from zero",
    )
    group = parser.add_argument_group("running")
    cores = _cores()
    group.add_argument(
        "--workers",
        type=int,
        default=cores,
        help=f"trials at a time on this machine (default: {cores}, its cores)",
    )
    group.add_argument(
        "--scheduler", help="of a Dask cluster to run on, tcp://host:port"
    )
    group.add_argument(
        "--timeout",
        type=finite,
        default=Sweep.timeout,
        help="wall time after which a trial counts as hung "
        "(default: %(default)g) [s]",
    )
    group = parser.add_argument_group("output")
    group.add_argument(
        "--out",
        type=place,
        help="folder for the results (default: envelopes/<date>_<protocol>); "
        f"one with a {DATABASE} goes on",
    )
    group.add_argument(
        "--plot-only",
        type=place,
        metavar="FOLDER",
        help=f"only write what follows from FOLDER/{DATABASE}",
    )
    group.add_argument(
        "--limit",
        action="store_true",
        help="simulate no push: print what no controller can recover from",
    )
    return parser


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):  # macOS has none
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


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
            sweep.known_limits = {
                cell: limit.recovered
                for cell, limit in found_limits(
                    rows.identity, rows.all()
                ).items()
                if limit is not None
            }
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
    folder, code = rows.path.parent, DONE
    start = progress_of(searches_of(sweep, rows.all()))
    say(*_plan_lines(sweep, start, slots), f"into {folder}")
    with until_ctrl_c() as stopped:
        try:
            with progress_bar(start) as show:
                if not run_sweep(sweep, rows, executor, slots, show, stopped):
                    code = INTERRUPTED
        except RuntimeError as error:
            code = _complain(error, FAILED)
        if rows.all():
            try:
                if _report(rows, [SCENARIO, COMMAND]).undecided:
                    code = code or UNDECIDED
            except ValueError as error:  # no trial was decided
                return _complain(error, UNDECIDED)
        if code in (FAILED, INTERRUPTED):
            say(f"the same flags and --out {folder} go on from here")
    return code


def _plan_lines(sweep: Sweep, progress: Progress, slots: int) -> list[str]:
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
        return UNDECIDED if _report(rows, []).undecided else DONE


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
            lines = limit_lines(walk, at, sweep.plant, directions)
            say(*lines)
    return DONE


def _report(rows: Rows, written: list[str]) -> LimitTable:
    """Writes the report; prints the table, and the names of all files.

    Raises:
        ValueError: no trial was decided.
        OSError: a file cannot be written.
    """
    folder = rows.path.parent
    rows.export(folder)
    limits = limit_table(rows.identity, rows.all(), folder / SCENARIO)
    written = [*write_report(folder, limits), DATABASE, *EXPORTS, *written]
    say(*said_lines(limits), f"wrote {folder}/{{{', '.join(written)}}}")
    return limits


if __name__ == "__main__":
    sys.exit(main())
