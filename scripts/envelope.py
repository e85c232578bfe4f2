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
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from dask.system import CPU_COUNT

from nadia_balance.core.walking.push import Moment
from nadia_balance.diagrams.scenario import (
    AT,
    STANDING,
    Scenario,
    load_scenario,
)
from nadia_balance.diagrams.simulation import closed_loop, until_ctrl_c
from nadia_balance.parameters.bounds import check
from nadia_balance.results.folder import prepare_folder
from nadia_balance.robot.model import load_robot
from nadia_balance.scripts import command_line
from nadia_balance.sweep import limits, report, run_trial
from nadia_balance.sweep.search import SearchParams, Sweep
from nadia_balance.sweep.trials import TRIALS, Rows

SCENARIO, COMMAND = "scenario.yaml", "command.txt"
MOST_DIRECTIONS = 72  # largest count of directions
QUICK = {"directions": "8", "resolution": 0.1, "stride": 4, "replicas": 1}


@command_line.program
def main(argv: list[str] | None = None) -> int:
    """Runs the command line `argv`; returns the exit code of --help."""
    parser = parser_of()
    args = parser.parse_args(argv)
    if args.plot_only is not None:
        with parser.refusing():
            rows = Rows.read(args.plot_only)
            search = vars(SearchParams())
            check(SearchParams(**{n: rows.identity[n] for n in search}))
            load_robot(rows.identity["robot"])
            file = rows.folder / SCENARIO
            names = rows.identity["scenario"].split(",")
            scenarios = {name: load_scenario(name, file) for name in names}
        return _report(rows, scenarios)
    with parser.refusing():
        sweep = sweep_from(args)
        sweep.first = limits.first_pushes(sweep)
    now = datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
    args.out = args.out or Path("envelopes") / f"{now}_{args.protocol}"
    return carry_out(
        parser, args, argv, sweep, lambda rows: _report(rows, sweep.scenarios)
    )


def parser_of() -> command_line.CommandLine:
    """Returns the parser of the command line."""
    codes = "0 done, 1 the workers failed, 2 bad input, 3 undecided (too short "
    codes += "runs), 4 cannot write, 130 Ctrl-C."
    whole = {"formatter_class": argparse.RawDescriptionHelpFormatter}
    parser = command_line.CommandLine(__file__, __doc__, codes, **whole)
    about = "By default, the protocol's; directions and moments: with commas."
    finite, place = command_line.finite, command_line.place
    add = parser.add_argument_group("sweep", about).add_argument
    which = {"choices": limits.PROTOCOLS, "default": "nadia_fig10"}
    about = "the paper's figure (default: %(default)s)"
    add("--protocol", **which, help=about)
    about = f"unless given: {QUICK}, and the most mechanisms alone"
    add("--quick", action="store_true", help=about)
    about = 'degrees from the stance heading, such as "0,30,90" (0 forward, 90 '
    about += 'left; "90," for one), or how many all around'
    add("--directions", help=about)
    about = f"when the push begins, such as {AT.replace('%', '%%')}, "
    about += f'or "{STANDING}", told to walk nowhere'
    add("--at", help=about)
    add("--resolution", type=finite, help="of the limit [m/s]")
    add("--stride", type=int, help="of the march upward, in resolutions")
    about = "of a push at the limit; four in five must be recovered from"
    add("--replicas", type=int, help=about)
    command_line.scenario_flags(parser, name="the protocol's")
    add = parser.add_argument_group("running").add_argument
    running_flags(add, "envelopes/<date>_<protocol>")
    about = f"only write what follows from FOLDER/{TRIALS}"
    add("--plot-only", type=place, metavar="FOLDER", help=about)
    return parser


def running_flags(add: Callable, out: str) -> None:
    """Adds the flags of `carry_out`; `out` is what help calls the default."""
    about = "processes on this machine (default: all its cores)"
    add("--workers", type=int, default=CPU_COUNT, help=about)
    about = "of a Dask cluster to run on, tcp://host:port"
    add("--scheduler", help=about)
    about = f"folder for the results; one with a {TRIALS} goes on (default: "
    add("--out", type=command_line.place, help=f"{about}{out})")


def carry_out(parser, args, argv, sweep: Sweep, report: Callable) -> int:
    """Runs the sweep, and the report, also after an error or Ctrl-C.

    Returns the exit code: that of `report(rows)` if the sweep is complete.
    """
    argv = sys.argv[1:] if argv is None else argv
    with contextlib.ExitStack() as stack:
        with parser.refusing():
            # Building a diagram checks the robot and the blocks, too.
            for cell in {cell[0]: cell for cell in sweep.cells()}.values():
                walk = sweep.walk(cell, replica=0)
                closed_loop(walk, sweep.plant, sweep.controller)
            workers = run_trial.open_workers(args.workers, args.scheduler)
            executor = stack.enter_context(workers)
            folder = prepare_folder(args.out)
            rows = stack.enter_context(Rows.opened(folder, sweep.identity()))
        with open(folder / COMMAND, "a", encoding="utf-8") as file:
            file.write(f"{shlex.join([parser.prog, *argv])}\n")
        named = sweep.scenarios.items()
        texts = (one.as_yaml(name) for name, one in named)
        (folder / SCENARIO).write_text("".join(texts), encoding="utf-8")
        counts = f"{len(sweep.cells())} cells; {len(rows.all)} trials"
        command_line.say(f"{counts} are there already", f"into {folder}")
        code, stopped = command_line.DONE, stack.enter_context(until_ctrl_c())
        try:
            if not run_trial.run_sweep(sweep, rows, executor, stopped):
                code = command_line.INTERRUPTED
        except RuntimeError as error:
            command_line.complain(parser.prog, error)
            code = command_line.FAILED
        reported = report(rows)
        if code:
            again = f"the same flags and --out {folder}"
            command_line.say(f"{again} go on from here")
        return code or reported


def _report(rows: Rows, scenarios: dict[str, Scenario]) -> int:
    """Writes and prints the limits; returns UNDECIDED if a cell has none."""
    if {row["outcome"] for row in rows.all} <= {"undecided"}:
        why = "; ".join({row["reason"] for row in rows.all})
        none = f"no limit: of {len(rows.all)} trials none was decided: {why}"
        command_line.complain("envelope.py", ValueError(none))
        return command_line.UNDECIDED
    found = limits.limit_table(rows, scenarios)
    names = ", ".join([*report.write_report(found, rows), TRIALS])
    for situation in found.situations:
        table = report.table_of(found, situation, report.RECOVERED)
        command_line.say("", ", ".join(situation), *table)
    trials = f"trials {report.outcomes(rows)}"
    command_line.say(trials, f"wrote {rows.folder}/{{{names}}}")
    tried = [r["recovered"] for r in found.records if r["trials"]]
    return command_line.UNDECIDED if None in tried else command_line.DONE


def sweep_from(args: argparse.Namespace) -> Sweep:
    """Returns the sweep of the flags; ValueError names an invalid one."""
    asked = dict(vars(limits.PROTOCOLS[args.protocol]))
    controller = command_line.policy_of(args)
    if args.quick or controller:
        asked["mechanisms"] = asked["mechanisms"].split(",")[-1]
    if args.quick:
        asked |= QUICK
    asked |= {name: x for name, x in vars(args).items() if x is not None}
    search = set(vars(SearchParams())) & set(asked)
    names = words("scenario_name", asked)
    sweep = Sweep(
        scenarios={name: scenario_of(args, name) for name in names},
        plant=args.plant,
        controller=controller,
        directions=directions(asked),
        at=moments(asked),
        mechanisms=words("mechanisms", asked),
        search=SearchParams(**{name: asked[name] for name in search}),
    )
    sweep.validate()
    return sweep


def scenario_of(args: argparse.Namespace, name: str) -> Scenario:
    """Returns the scenario `name`, with its own mechanisms."""
    one = vars(args) | {"scenario_name": name, "mechanisms": None}
    return command_line.scenario_from(argparse.Namespace(**one))


def moments(asked: dict[str, str]) -> tuple[str, ...]:
    """Returns the moments `at` which to push; ValueError: it is none."""
    return tuple(
        text if text == STANDING else str(Moment.parse(text))
        for text in words("at", asked)
    )


def directions(asked: dict[str, str]) -> tuple[float, ...]:
    """Returns the `directions` [deg] that are asked for, listed or counted."""
    text = asked["directions"].strip()
    with contextlib.suppress(ValueError):
        if not (text.isdecimal() and text.isascii()):
            angles = [float(word) for word in words("directions", asked)]
            if all(abs(angle) <= 3600.0 for angle in angles):
                found = (round(angle, 6) % 360.0 for angle in angles)
                return tuple(dict.fromkeys(found))
        elif 1 <= (count := int(text)) <= MOST_DIRECTIONS:
            return tuple(round(i * 360.0 / count, 6) for i in range(count))
    raise ValueError(
        f'directions = {text!r}: must be degrees, such as "0,30,90" or "90,", '
        f"or how many, from 1 to {MOST_DIRECTIONS}"
    )


def words(name: str, asked: dict[str, str]) -> tuple[str, ...]:
    """The words that are asked for, each once."""
    words = [word.strip() for word in asked[name].split(",")]
    if found := tuple(filter(None, dict.fromkeys(words))):
        return found
    raise ValueError(f"{name} = {asked[name]!r}: must name at least one")


if __name__ == "__main__":
    sys.exit(main())
