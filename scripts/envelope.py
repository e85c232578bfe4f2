"""Finds the largest pushes that the robot recovers from, all around it.

The limit of each gait, moment, direction and set of mechanisms is searched, as
in the Nadia paper's Fig. 10, or the Atlas paper's Fig. 6.  Finished trials are
kept: the same flags, and --out with the folder, go on after Ctrl-C or a power
cut.  Directions, mechanisms and moments can be added in the same way.

Example:
    python scripts/envelope.py --directions "0,90" --mechanisms icp_only,step
"""

import nadia_balance.scripts.interrupts  # noqa: F401  # isort: skip (first, for Ctrl-C)
import argparse
import contextlib
import shlex
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from dask.system import CPU_COUNT

from nadia_balance.core.walking.push import Moment
from nadia_balance.diagrams.own_blocks import parsed_blocks
from nadia_balance.diagrams.scenario import (
    AT,
    STANDING,
    Scenario,
    load_scenario,
)
from nadia_balance.diagrams.simulation import until_ctrl_c
from nadia_balance.parameters.bounds import check, require
from nadia_balance.results.folder import prepare_folder
from nadia_balance.robot.model import load_robot
from nadia_balance.scripts import command_line
from nadia_balance.sweep import limits, push_v1, report, run_trial
from nadia_balance.sweep.envelope import (
    MOST_DIRECTIONS,
    all_around,
    keep_contract,
)
from nadia_balance.sweep.row import ROW, lines_of, write_row
from nadia_balance.sweep.search import SearchParams, Sweep
from nadia_balance.sweep.tour import Tour
from nadia_balance.sweep.trials import TRIALS, UNDECIDED, Rows

SCENARIO, COMMAND = "scenario.yaml", "command.txt"
QUICK = {"directions": "8", "resolution": 0.1, "stride": 4, "replicas": 1}
# Flags that push-v1 leaves to the user.
FREE = (
    "protocol",
    "quick",
    "robot",
    "controller",
    "contract",
    "block",
    "who",
    "workers",
    "scheduler",
    "out",
)


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs a command line.

    Args:
        argv: its words; None: those of the process.

    Returns:
        The exit code of --help.
    """
    parser = parser_of()
    args = parser.parse_args(argv)
    if args.protocol == push_v1.NAME:
        return _measure_row(parser, args, argv)
    if args.plot_only is not None:
        with parser.refusing():
            rows = Rows.read(args.plot_only)
            _require_only(("plot_only", "beside"), parser, args, "--plot-only")
            check(SearchParams.of(rows.identity))
            load_robot(rows.identity["robot"])
            scenarios = {
                name: load_scenario(name, rows.folder / SCENARIO)
                for name in rows.identity["scenario"].split(",")
            }
            limits.check_beside(args.beside, rows.identity, rows.by_cell())
        return _report(rows, scenarios, args.beside)
    with parser.refusing():
        sweep = sweep_from(args)
        limits.check_beside(args.beside, sweep.identity(), sweep.cells())
        sweep.first = limits.first_pushes(sweep)
    args.out = args.out or Path(
        f"envelopes/{datetime.now():%Y-%m-%d_%H-%M-%S}_{args.protocol}"
    )
    return carry_out(
        parser=parser,
        args=args,
        argv=argv,
        sweep=sweep,
        report=lambda rows: _report(rows, sweep.scenarios, args.beside),
    )


def parser_of() -> command_line.CommandLine:
    """Makes the parser of the command line.

    Returns:
        The parser.
    """
    parser = command_line.CommandLine(
        __file__,
        __doc__,
        "0 done, 1 workers or a block failed, 2 bad input, 3 undecided (too "
        "short runs), 4 cannot write, 130 Ctrl-C.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _sweep_flags(parser)
    command_line.scenario_flags(parser, name="the protocol's")
    group = parser.add_argument_group("running")
    running_flags(group, "envelopes/<date>_<protocol>")
    group.add_argument(
        "--plot-only",
        type=command_line.place,
        metavar="FOLDER",
        help=f"only write what follows from FOLDER/{TRIALS}; with no other "
        "flag but --beside",
    )
    group.add_argument(
        "--beside",
        type=command_line.place,
        metavar="FOLDER",
        help="of another sweep, whose limits are written and drawn beside",
    )
    return parser


def _sweep_flags(parser: command_line.CommandLine) -> None:
    group = parser.add_argument_group(
        "sweep",
        "By default, the protocol's; directions and moments: with commas.",
    )
    group.add_argument(
        "--protocol",
        choices=[*limits.PROTOCOLS, push_v1.NAME],
        default="nadia_fig10",
        help=f"the paper's figure, or that of the league, {push_v1.NAME} "
        "(default: %(default)s)",
    )
    group.add_argument(
        "--quick",
        action="store_true",
        help=f"unless given: {QUICK}, and the most mechanisms alone; of "
        f"{push_v1.NAME}: its quick variant",
    )
    group.add_argument(
        "--who", default="", help=f"has measured the row of {push_v1.NAME}"
    )
    group.add_argument(
        "--directions",
        help='degrees from the stance heading, such as "0,30,90" (0 forward, '
        '90 left; "90," for one), or how many all around',
    )
    group.add_argument(
        "--at",
        help=f"when the push begins, such as {AT.replace('%', '%%')}, "
        f'or "{STANDING}": without steps, at 1 s',
    )
    group.add_argument(
        "--resolution", type=command_line.finite, help="of the limit [m/s]"
    )
    group.add_argument(
        "--stride", type=int, help="of the march upward, in resolutions"
    )
    group.add_argument(
        "--replicas",
        type=int,
        help="of a push at the limit; four in five must be recovered from",
    )


def running_flags(
    group: argparse._ArgumentGroup, out: str, rows: str = TRIALS
) -> None:
    """Adds the flags of `carry_out`.

    Args:
        group: of a parser.
        out: what help calls the default of --out.
        rows: file that a folder has which goes on.
    """
    group.add_argument(
        "--workers",
        type=int,
        default=CPU_COUNT,
        help="processes on this machine (default: all its cores)",
    )
    group.add_argument(
        "--scheduler", help="of a Dask cluster to run on, tcp://host:port"
    )
    group.add_argument(
        "--out",
        type=command_line.place,
        help=f"folder for the results; one with a {rows} goes on (default: "
        f"{out})",
    )


def carry_out(
    *,
    parser: command_line.CommandLine,
    args: argparse.Namespace,
    argv: list[str] | None,
    sweep: Sweep | Tour,
    report: Callable[[Any], int],
    run: Callable[..., bool] = run_trial.run_sweep,
    part: str = "",
) -> int:
    """Runs a sweep, and its report, also after an error or Ctrl-C.

    Args:
        parser: of the program.
        args: those of running_flags.
        argv: the command line, for its file; None: that of the process.
        sweep: what is run.
        report: writes what follows from the rows; returns an exit code.
        run: makes the trials that the rows lack.
        part: folder in --out, of one of several sweeps.

    Returns:
        The exit code: that of `report` if the sweep is complete.
    """
    with contextlib.ExitStack() as stack:
        with parser.refusing():
            diagram = sweep.try_out()
            executor = stack.enter_context(
                run_trial.open_workers(args.workers, args.scheduler)
            )
            folder = prepare_folder(args.out / part)
            rows = stack.enter_context(sweep.opened(folder))
        command = [parser.prog, *(sys.argv[1:] if argv is None else argv)]
        with open(folder / COMMAND, "a", encoding="utf-8") as file:
            file.write(f"{shlex.join(command)}\n")
        (folder / SCENARIO).write_text(
            "".join(one.as_yaml(name) for name, one in sweep.scenarios.items()),
            encoding="utf-8",
        )
        command_line.say(
            *(f"robot: {remark}" for remark in diagram.remarks()),
            *(f"policy: {line}" for line in keep_contract(folder, diagram)),
            f"{len(sweep.cells())} cells; {len(rows.all)} trials are there "
            "already",
            f"into {folder}",
        )
        code, stopped = command_line.DONE, stack.enter_context(until_ctrl_c())
        try:
            if not run(sweep, rows, executor, stopped):
                code = command_line.INTERRUPTED
        except RuntimeError as error:
            command_line.complain(parser.prog, error)
            code = command_line.FAILED
        reported = report(rows)
        if code:
            command_line.say(
                f"the same flags and --out {args.out} go on from here"
            )
        return code or reported


def _report(
    rows: Rows, scenarios: dict[str, Scenario], beside: Path | None
) -> int:
    """Writes and prints the limits; returns UNDECIDED if a cell has none."""
    if {row["outcome"] for row in rows.all} <= {UNDECIDED}:
        command_line.complain(
            "envelope.py",
            ValueError(
                f"no limit: of {len(rows.all)} trials none was decided: "
                f"{'; '.join({row['reason'] for row in rows.all})}"
            ),
        )
        return command_line.UNDECIDED
    table = limits.limit_table(rows, scenarios, beside)
    files = ", ".join([*report.write_report(table, rows), TRIALS])
    for situation in table.situations:
        command_line.say(
            "",
            ", ".join(situation),
            *report.table_of(table, situation, report.RECOVERED),
        )
    command_line.say(
        f"trials {report.outcomes(rows)}", f"wrote {rows.folder}/{{{files}}}"
    )
    tried = [one["recovered"] for one in table.records if one["trials"]]
    return command_line.UNDECIDED if None in tried else command_line.DONE


def sweep_from(args: argparse.Namespace) -> Sweep:
    """The sweep of the flags.

    Args:
        args: those of parser_of.

    Returns:
        The sweep, checked.

    Raises:
        ValueError: names the invalid flag.
    """
    require(not args.who, f"who = {args.who!r}: must come with {push_v1.NAME}")
    values = asdict(limits.PROTOCOLS[args.protocol])
    controller = command_line.controller_of(args)
    if args.quick or controller:
        values["mechanisms"] = values["mechanisms"].split(",")[-1]
    if args.quick:
        values |= QUICK
    values |= {name: x for name, x in vars(args).items() if x is not None}
    sweep = Sweep(
        scenarios={
            name: scenario_of(args, name)
            for name in words("scenario_name", values)
        },
        plant=args.plant,
        controller=controller,
        contract=command_line.contract_of(args),
        blocks=parsed_blocks(args.block or ()),
        directions=directions(values),
        at=moments(values),
        mechanisms=words("mechanisms", values),
        search=SearchParams.of(values),
    )
    sweep.validate()
    return sweep


def sweeps_of_row(
    parser: command_line.CommandLine, args: argparse.Namespace
) -> dict[str, Sweep]:
    """The sweeps of a row of push-v1.

    Args:
        parser: of the program.
        args: those of parser_of.

    Returns:
        The sweeps by the names of their folders, checked.

    Raises:
        ValueError: names the invalid flag, or one that push-v1 fixes.
    """
    require(bool(args.who), "who = '': must be given, your name")
    _require_only(FREE, parser, args, f"{push_v1.NAME}, which has its own")
    return push_v1.sweeps(
        push_v1.QUICK if args.quick else push_v1.FULL,
        args.robot or "nadia",
        command_line.controller_of(args),
        parsed_blocks(args.block or ()),
        command_line.contract_of(args),
    )


def _require_only(
    names: tuple[str, ...],
    parser: command_line.CommandLine,
    args: argparse.Namespace,
    other: str,
) -> None:
    """Requires that no flags but those of these names are given."""
    for name, value in vars(args).items():
        require(
            name in names or value == parser.get_default(name),
            f"{name} = {value}: must not come with {other}",
        )


def _measure_row(
    parser: command_line.CommandLine,
    args: argparse.Namespace,
    argv: list[str] | None,
) -> int:
    """Carries out the sweeps of a row, then writes it; returns a code."""
    with parser.refusing():
        sweeps = sweeps_of_row(parser, args)
        for sweep in sweeps.values():
            sweep.try_out()
            sweep.first = limits.first_pushes(sweep)
    args.out = args.out or Path(f"rows/{datetime.now():%Y-%m-%d_%H-%M-%S}")
    for name, sweep in sweeps.items():
        code = carry_out(
            parser=parser,
            args=args,
            argv=argv,
            sweep=sweep,
            report=partial(_report, scenarios=sweep.scenarios, beside=None),
            part=name,
        )
        # Who does not walk is not pushed in a gait: that is a result, too.
        if code not in (command_line.DONE, command_line.UNDECIDED):
            return code
    variant = push_v1.QUICK if args.quick else push_v1.FULL
    row = write_row(args.out, variant, sweeps, args.who)
    command_line.say(
        "", *lines_of(row), f"wrote {args.out}/{{{ROW}, {TRIALS}}}"
    )
    return command_line.DONE


def scenario_of(args: argparse.Namespace, name: str) -> Scenario:
    """A scenario of the flags, with its own mechanisms.

    Args:
        args: those of command_line.scenario_flags.
        name: of the scenario.

    Returns:
        The scenario.

    Raises:
        ValueError: as command_line.scenario_from.
    """
    return command_line.scenario_from(
        argparse.Namespace(
            **(vars(args) | {"scenario_name": name, "mechanisms": None})
        )
    )


def moments(asked: Mapping[str, Any]) -> tuple[str, ...]:
    """The moments at which to push.

    Args:
        asked: values of flags, of which `at` is read.

    Returns:
        Moments, as Moment writes them, or STANDING.

    Raises:
        ValueError: there is none, or one is no moment.
    """
    return tuple(
        text if text == STANDING else str(Moment.parse(text))
        for text in words("at", asked)
    )


def directions(asked: Mapping[str, Any]) -> tuple[float, ...]:
    """The directions of pushes, listed or counted.

    Args:
        asked: values of flags, of which `directions` is read.

    Returns:
        Angles in [0, 360) [deg], each once.

    Raises:
        ValueError: these are neither degrees nor a count.
    """
    text = asked["directions"].strip()
    with contextlib.suppress(ValueError):
        if text.isdecimal() and text.isascii():
            count = int(text)
            if 1 <= count <= MOST_DIRECTIONS:
                return all_around(count)
        else:
            angles = [float(word) for word in words("directions", asked)]
            if all(abs(angle) <= 3600.0 for angle in angles):
                return tuple(
                    dict.fromkeys(round(angle, 6) % 360.0 for angle in angles)
                )
    raise ValueError(
        f'directions = {text!r}: must be degrees, such as "0,30,90" or "90,", '
        f"or how many, from 1 to {MOST_DIRECTIONS}"
    )


def words(name: str, asked: Mapping[str, Any]) -> tuple[str, ...]:
    """The words of a flag with commas.

    Args:
        name: of the flag.
        asked: values of flags.

    Returns:
        The words, each once.

    Raises:
        ValueError: there is none.
    """
    parts = dict.fromkeys(word.strip() for word in asked[name].split(","))
    parts.pop("", None)
    require(len(parts) > 0, f"{name} = {asked[name]!r}: must name at least one")
    return tuple(parts)


if __name__ == "__main__":
    sys.exit(main())
