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
from nadia_balance.scripts.envelope_sweep.limits import Envelope, envelope_of
from nadia_balance.scripts.envelope_sweep.physical import (
    limit_lines,
    with_limits,
)
from nadia_balance.scripts.envelope_sweep.plan import (
    Sweep,
    sweep_flags,
    sweep_from,
)
from nadia_balance.scripts.envelope_sweep.report import (
    table_lines,
    write_report,
)
from nadia_balance.scripts.envelope_sweep.run import (
    agenda_of,
    progress_bar,
    run_sweep,
)
from nadia_balance.scripts.envelope_sweep.search import Progress
from nadia_balance.scripts.envelope_sweep.trial import DIAGRAMS
from nadia_balance.scripts.envelope_sweep.trials_file import (
    TrialsFile,
    alone_in,
    read_trials,
    recovered,
)
from nadia_balance.scripts.envelope_sweep.workers import Workers, open_workers

TRIALS = "trials.csv"


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
        return _main(args, stack)


def _main(args: argparse.Namespace, stack: contextlib.ExitStack) -> int:
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
        help="march up from 0.16 m/s below the limits that an earlier sweep "
        "found in FOLDER, not from zero",
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
        "one with a trials.csv goes on",
    )
    group.add_argument(
        "--plot-only",
        type=place,
        metavar="FOLDER",
        help="only write what follows from FOLDER/trials.csv",
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
) -> tuple[Sweep, TrialsFile, Workers]:
    """Checks the flags, then opens the workers and the files of a run.

    Raises:
        ValueError: a flag is invalid, or a trials.csv is of another sweep.
        OSError: a file is missing, or cannot be written.
    """
    sweep = sweep_from(args)
    if args.known is not None:
        envelope = envelope_of(*read_trials(_trials_in("from", args.known)))
        sweep.known_limits = {
            cell: limit.recovered for cell, limit in envelope.limits.items()
        }
    identity = sweep.identity()
    # Building a diagram checks the robot and the blocks, too.
    firsts = {cell.situation.scenario: cell for cell in sweep.cells()}
    for cell in firsts.values():
        DIAGRAMS[sweep.plant](sweep.walk(cell, replica=0))
    workers = stack.enter_context(open_workers(args.workers, args.scheduler))
    out = args.out
    if out is None:
        now = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
        out = Path("envelopes") / f"{now}_{args.protocol}"
    folder = prepare_folder(out)
    stack.enter_context(alone_in(folder))
    trials_file = TrialsFile(folder / TRIALS, identity)
    texts = (
        yaml_dump_typed(scenario, child_name=name)
        for name, scenario in sweep.scenarios.items()
    )
    (folder / "scenario.yaml").write_text("".join(texts), encoding="utf-8")
    with open(folder / "command.txt", "a", encoding="utf-8") as file:
        file.write(f"{args.command}\n")
    return sweep, trials_file, workers


def _run(sweep: Sweep, trials_file: TrialsFile, workers: Workers) -> int:
    """Runs the sweep and writes the report, also after an error or Ctrl-C."""
    folder, code = trials_file.path.parent, DONE
    progress = agenda_of(sweep, trials_file).progress()
    lines = _plan_lines(sweep, progress, workers.slots, folder)
    say(*lines)
    with until_ctrl_c() as stopped:
        try:
            with progress_bar(progress) as show:
                if not run_sweep(sweep, trials_file, workers, show, stopped):
                    code = INTERRUPTED
        except RuntimeError as error:
            code = _complain(error, FAILED)
        trials_file.finish()
        if rows := trials_file.rows():
            if all(recovered(row) is None for row in rows):
                why = f"no limit: of {len(rows)} trials none was decided: "
                return _complain(ValueError(why + rows[0]["reason"]), UNDECIDED)
            written = [TRIALS, "costs.csv", "scenario.yaml", "command.txt"]
            if _report(folder, written).undecided and code == DONE:
                code = UNDECIDED
        if code in (FAILED, INTERRUPTED):
            say(f"the same flags and --out {folder} go on from here")
    return code


def _plan_lines(
    sweep: Sweep, progress: Progress, slots: int, folder: Path
) -> list[str]:
    """Lines with the numbers of limits and trials, and the folder."""
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
        f"into {folder}",
    ]


def _plot_only(folder: Path) -> int:
    _trials_in("plot_only", folder)
    envelope = _report(prepare_folder(folder), [])
    return UNDECIDED if envelope.undecided else DONE


def _trials_in(flag: str, folder: Path) -> Path:
    if not (path := folder / TRIALS).is_file():
        raise ValueError(
            f"{flag} = {str(folder)!r}: must be a folder with a {TRIALS}"
        )
    return path


def _limit(sweep: Sweep) -> int:
    """Prints the limits of a point mass with the robot's parameters."""
    most, directions = sweep.mechanisms[-1], sweep.directions
    for cell in sweep.cells():
        if (cell.mechanisms, cell.direction_deg) == (most, directions[0]):
            walk, at = sweep.walk(cell, replica=0), cell.situation
            lines = limit_lines(walk, at, sweep.plant, directions)
            say(*lines)
    return DONE


def _report(folder: Path, written: list[str]) -> Envelope:
    """Writes the report; prints the table, and the names of all files."""
    envelope = envelope_of(*read_trials(folder / TRIALS))
    envelope = with_limits(envelope, folder / "scenario.yaml")
    written = [*write_report(folder, envelope), *written]
    say(*table_lines(envelope), f"wrote {folder}/{{{', '.join(written)}}}")
    return envelope


if __name__ == "__main__":
    sys.exit(main())
